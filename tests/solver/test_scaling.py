"""Scaling: what a body twice as large must have, by geometry alone, and what is reported of one that does not fit."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from recordings.exchange.trc import read_trc
from solver.bundled import bundled_model
from solver.constraint import ConstantDistanceConstraint, PointOnLineConstraint
from solver.errors import ScalingCode, SolverCode
from solver.forces.actuators import PointActuator
from solver.forces.passive_forces import (
    Bushing,
    ConstantForce,
    ContactMaterial,
    ContactSurface,
    HuntCrossleyContact,
    PathSpring,
    PointToPointSpring,
)
from solver.inverse_kinematics.solve import TrackingTasks, assemble
from solver.model import Placement, PointConstraint
from solver.multibody.postures import postures
from solver.muscle import evaluate_paths
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import read_scale_setup
from solver.scaling import Scaling, check_scaling, place_markers, scale_model
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import seen_from
from tests.solver.references import SHARED

MODEL = bundled_model()
BODIES = [body.name for body in MODEL.bodies[1:]]
SIZE = 1.05


def forces_between(one: int, two: int) -> tuple[Any, ...]:
    """One force of each kind, between the two bodies."""
    frame = Placement(np.eye(3), np.array([0.01, 0.02, -0.03]))
    points = {"body_1": one, "body_2": two, "point_1": np.array([0.01, 0.0, 0.02]), "point_2": np.array([0, 0.1, 0.0])}
    material = ContactMaterial(1e6, 0.0, 0.0, 0.0, 0.0)
    surfaces = (ContactSurface(one, frame, None, material), ContactSurface(two, frame, 0.05, material))
    return (
        PathSpring("band", MODEL.muscles[0].path, 0.1, 100.0, 0.0),
        Bushing("cushion", one, two, frame, frame, np.zeros(6), np.ones(6)),
        PointToPointSpring("string", **points, stiffness=50.0, rest_length=0.3),
        ConstantForce("weight", two, np.array([0.0, 0.1, 0.0]), np.ones(3), np.zeros(3), False, True),
        HuntCrossleyContact("floor", surfaces, 0.1),
    )


def test_forces_are_scaled_with_their_bodies() -> None:
    scapula, humerus = MODEL.body_index("scapula"), MODEL.body_index("humerus")
    pusher = PointActuator(
        name="pusher", optimal_force=1.0, body=humerus, point=np.ones(3), direction=np.array([1.0, 0.0, 0.0])
    )
    model = replace(MODEL, forces=forces_between(scapula, humerus), actuators=(*MODEL.actuators, pusher))
    factors = {"scapula": [1.1, 0.9, 1.2], "humerus": [1.3, 1.0, 0.8]}
    band, cushion, string, weight, floor = scale_model(model, Scaling(factors)).forces
    old = model.forces
    grown = scale_model(MODEL, Scaling(factors)).muscles[0].tendon_slack_length / MODEL.muscles[0].tendon_slack_length
    assert band.resting_length == pytest.approx(0.1 * grown, rel=1e-12)
    assert band.stiffness == 100.0
    np.testing.assert_allclose(cushion.frame_1.translation, [0.011, 0.018, -0.036])
    np.testing.assert_allclose(cushion.frame_2.translation, [0.013, 0.02, -0.024])
    np.testing.assert_allclose(string.point_2, old[2].point_2 * factors["humerus"])
    np.testing.assert_allclose(weight.point, old[3].point * factors["humerus"])
    np.testing.assert_allclose(floor.surfaces[1].placement.translation, [0.013, 0.02, -0.024])
    assert floor.surfaces[1].radius == pytest.approx(0.05 * np.mean(factors["humerus"]))
    np.testing.assert_allclose(scale_model(model, Scaling(factors)).actuators[-1].point, factors["humerus"])


class Wind:
    name = "wind"


ENDS = "held", 1, 2, np.zeros(3), np.zeros(3)


@pytest.mark.parametrize(
    ("changes", "naming"),
    [
        ({"forces": (Wind(),)}, "wind"),
        ({"constraints": (ConstantDistanceConstraint(*ENDS, 0.4),)}, "held"),
        ({"constraints": (PointOnLineConstraint(*ENDS, np.eye(3)[0]),)}, "held"),
    ],
    ids=["force without a rule", "distance", "line"],
)
def test_what_has_no_rule_is_not_scaled(changes: dict[str, Any], naming: str) -> None:
    with raises_refusal(SolverCode.UNSUPPORTED, naming):
        scale_model(replace(MODEL, **changes), Scaling({"thorax": [1.1] * 3}))


def test_a_body_that_is_larger_in_all_directions_is_similar() -> None:
    """Lengths grow with the size, masses with its cube, inertias with its fifth power, angles stay."""
    scaled = scale_model(MODEL, Scaling(dict.fromkeys(["ground", *BODIES], [SIZE] * 3)))
    for old, new in zip(MODEL.bodies, scaled.bodies, strict=True):
        assert new.mass == pytest.approx(old.mass * SIZE**3)
        np.testing.assert_allclose(new.inertia, old.inertia * SIZE**5, rtol=1e-12, atol=1e-18)
    angles = [coordinate.motion == "rotation" for coordinate in MODEL.coordinates]
    q = np.where(angles, assemble(MODEL), SIZE * assemble(MODEL))[None]
    old, new = (
        evaluate_paths(each, postures(each, posture, np.zeros_like(posture))).lengths[0]
        for each, posture in ((MODEL, assemble(MODEL)[None]), (scaled, q))
    )
    np.testing.assert_allclose(new, SIZE * old, rtol=1e-4)  # OpenSim's wrapping stops at lengths, not at parts of them
    for before, after in zip(MODEL.muscles, scaled.muscles, strict=True):
        assert after.optimal_fiber_length == pytest.approx(SIZE * before.optimal_fiber_length, rel=1e-4)
        assert after.max_isometric_force == before.max_isometric_force


def test_joined_points_are_stretched_unless_asked_otherwise() -> None:
    factors = {"clavicle": [1.1, 1.0, 0.9]}
    ours, theirs = (scale_model(MODEL, Scaling(factors, scales_joined_points=each)) for each in (True, False))
    joints = [next(c for c in each.constraints if isinstance(c, PointConstraint)) for each in (MODEL, ours, theirs)]
    clavicle = MODEL.body_index("clavicle")
    side = "location_1" if joints[0].body_1 == clavicle else "location_2"
    np.testing.assert_allclose(getattr(joints[1], side), getattr(joints[0], side) * factors["clavicle"])
    np.testing.assert_array_equal(getattr(joints[2], side), getattr(joints[0], side))


def test_masses_reach_the_total_and_keep_their_ratios_where_asked() -> None:
    factors = {"thorax": [1.2, 1.0, 1.0]}
    total = sum(body.mass for body in MODEL.bodies)
    grown = scale_model(MODEL, Scaling(factors, mass=2 * total))
    kept = scale_model(MODEL, Scaling(factors, mass=2 * total, keeps_masses=True))
    for scaled in (grown, kept):
        assert sum(body.mass for body in scaled.bodies) == pytest.approx(2 * total)
    hand = MODEL.body_index("hand")
    assert kept.bodies[hand].mass == pytest.approx(2 * MODEL.bodies[hand].mass)
    assert grown.bodies[hand].mass < 2 * MODEL.bodies[hand].mass


@pytest.mark.parametrize(
    ("scaling", "code"),
    [
        (Scaling({"wing": [1, 1, 1]}), SolverCode.UNKNOWN_NAME),
        (Scaling({"thorax": [1, 0, 1]}), SolverCode.NOT_POSITIVE),
        (Scaling({"thorax": [1, 1]}), SolverCode.NOT_POSITIVE),
        (Scaling({}, mass=-30.0), SolverCode.NOT_POSITIVE),
    ],
)
def test_invalid_factors_are_refused(scaling: Scaling, code: SolverCode) -> None:
    with raises_refusal(code):
        scale_model(MODEL, scaling)


def test_a_thorax_that_is_scaled_alone_is_a_finding() -> None:
    assert check_scaling(MODEL, MODEL) == ()
    scaled = scale_model(MODEL, Scaling({"thorax": [1.6, 1.0, 1.6]}))
    codes = {finding.code for finding in check_scaling(MODEL, scaled)}
    assert {ScalingCode.POINT_INSIDE_SURFACE, ScalingCode.PATH_LENGTH} & codes


def test_free_markers_move_to_where_they_were_seen_and_fixed_ones_stay() -> None:
    model = replace(MODEL, markers=tuple(replace(each, is_fixed=k % 2 == 0) for k, each in enumerate(MODEL.markers)))
    seen = seen_from(model, assemble(model)[None])[0]
    offset = np.where(np.arange(len(seen)) % 2 == 0, 0.0, 0.01)[:, None]
    labels = [marker.name for marker in model.markers]
    fixed = tuple(marker for marker in model.markers if marker.is_fixed)
    placed = place_markers(model, labels, seen + offset, TrackingTasks(fixed, np.ones(len(fixed))))
    for before, after in zip(model.markers, placed.markers, strict=True):
        moved = float(np.linalg.norm(after.location - before.location))
        assert moved == pytest.approx(0.0 if before.is_fixed else 0.01 * np.sqrt(3), abs=1e-6)


@pytest.mark.shared
def test_a_published_body_comes_back_from_its_set_up() -> None:
    """The published run had other names for the two markers of the wrist."""
    subject = SHARED / "subject"
    setup, published = read_scale_setup(subject / "scale_setup.xml"), read_osim(subject / "scaled.osim")
    generic = read_osim(subject / "generic.osim")
    names = {"US2": "RS2", "RS2": "RS2_0"}
    markers = tuple(replace(each, name=names.get(each.name, each.name)) for each in generic.markers)
    table = read_trc(subject / "S8R_side.trc")
    shown = (table.time_s >= setup.time_range[0] - 1e-6) & (table.time_s <= setup.time_range[1] + 1e-6)
    factors = setup.factors(replace(generic, markers=markers), table.labels, 1e-3 * table.positions[shown])
    measured = [factors["thorax"][1], factors["thorax"][0], factors["scapula"][0], factors["humerus"][1]]
    np.testing.assert_allclose(measured, [1.12257015, 1.38530274, 1.15629819, 1.00471602], rtol=1e-8)
    scaled = scale_model(generic, Scaling(factors, setup.mass, setup.keeps_masses, scales_joined_points=False))
    for ours, theirs in zip(scaled.bodies, published.bodies, strict=True):
        np.testing.assert_allclose(ours.inertia, theirs.inertia, rtol=5e-5, atol=1e-9)
    for one, other in zip(scaled.muscles, published.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=5e-5)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=5e-5)


SETUP = """<OpenSimDocument Version="40000"><ScaleTool name="s"><mass>-1</mass><ModelScaler><MeasurementSet><objects>
<Measurement name="m"><MarkerPairSet><objects><MarkerPair><markers>A B</markers></MarkerPair></objects></MarkerPairSet>
<BodyScaleSet><objects><BodyScale name="thigh"><axes>x Y</axes></BodyScale><BodyScale name="thigh"><axes>Z</axes>
</BodyScale></objects></BodyScaleSet></Measurement></objects></MeasurementSet></ModelScaler><MarkerPlacer><IKTaskSet>
<objects><IKMarkerTask name="A"><weight>100</weight></IKMarkerTask><IKMarkerTask name="A"><weight>1</weight>
</IKMarkerTask></objects></IKTaskSet></MarkerPlacer></ScaleTool></OpenSimDocument>"""


def test_what_a_set_up_has_twice_is_read_as_by_opensim(tmp_path: Path) -> None:
    """OpenSim 4.6 scales by both, and weights a marker by its first task."""
    path = tmp_path / "setup.xml"
    path.write_text(SETUP)
    setup = read_scale_setup(path)
    assert setup.measurements[0].axes == {"thigh": (0, 1, 2)}
    assert setup.placement is not None and setup.placement.markers == {"A": 100.0}
    path.write_text(SETUP.replace("A B", "A A"))
    with raises_refusal(SolverCode.MALFORMED, "A A"):
        read_scale_setup(path)
    path.write_text(SETUP.replace("IKMarkerTask", "IKCoordinateTask"))
    with raises_refusal(SolverCode.MALFORMED, "above"):
        read_scale_setup(path)
