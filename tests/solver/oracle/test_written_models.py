"""Written muscles and constraints, defaults and earlier versions: OpenSim opens the file, with equal accelerations."""

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.constraint import ConstantDistanceConstraint, CoordinateCoupler, PointOnLineConstraint
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.functions.muscle_curves import DeGrooteFreglyCurves, MillardCurves, SchutteCurves, ThelenCurves
from solver.osim.model_reader import read_osim
from tests.refusals import raises_refusal
from tests.solver.oracle.two_bodies import difference_to, model_with, opensim, printed, read_back, span, written
from tests.solver.osim.test_earlier_versions import opensim_3_document

PLACES = (0, 2, np.array([0.01, 0.0, 0.02]), np.array([0.0, 0.1, 0.0]))
CONSTRAINTS = {
    "distance": ConstantDistanceConstraint("held", *PLACES, 0.4),
    "line": PointOnLineConstraint("held", *PLACES, np.array([0.6, 0.0, 0.8])),
    "coupler": CoordinateCoupler("held", 1, (0,), (polynomial([0.1, 2.0, 0.3]),)),
    "coupler of two": CoordinateCoupler("held", 1, (0, 3), (polynomial([0.1, 2.0]), polynomial([0.0, 3.0]))),
}
ACTIVE = "<ActiveForceLengthCurve name='c'>{}</ActiveForceLengthCurve>"
MUSCLE = "<Millard2012EquilibriumMuscle name='default'>{}</Millard2012EquilibriumMuscle>"
SHORTEST = "<min_norm_active_fiber_length>0.33</min_norm_active_fiber_length>"
LONGEST = "<max_norm_active_fiber_length>1.62</max_norm_active_fiber_length>"
SLOPE = "<shallow_ascending_slope>0.7</shallow_ascending_slope>"
STRAIN = (
    "<FiberForceLengthCurve name='p'><strain_at_one_norm_force>0.5</strain_at_one_norm_force></FiberForceLengthCurve>"
)
SPEED = (
    "<ForceVelocityCurve name='v'>"
    "<max_eccentric_velocity_force_multiplier>1.7</max_eccentric_velocity_force_multiplier>"
    "<concentric_slope_at_vmax>0.2</concentric_slope_at_vmax></ForceVelocityCurve>"
)
STRENGTH = "<max_isometric_force>321</max_isometric_force><max_contraction_velocity>7</max_contraction_velocity>"
UNDAMPED = "<fiber_damping>0</fiber_damping>"
RIGID = "<ignore_tendon_compliance>true</ignore_tendon_compliance>"
CASES = {
    "nothing at all": ("", ""),
    "a muscle's numbers": (MUSCLE.format(STRENGTH), ""),
    "a muscle's curve": (MUSCLE.format(ACTIVE.format(SHORTEST + LONGEST) + STRAIN + SPEED), ""),
    "the muscle has a curve of its own": (MUSCLE.format(ACTIVE.format(SHORTEST)), ACTIVE.format(LONGEST)),
    "the muscle has an empty curve": (MUSCLE.format(ACTIVE.format(SHORTEST)), ACTIVE.format("")),
    "a curve's class, before the muscle": (ACTIVE.format(SLOPE) + MUSCLE.format(ACTIVE.format(SHORTEST)), ""),
    "a curve's class, behind the muscle": (MUSCLE.format(ACTIVE.format(SHORTEST)) + ACTIVE.format(SLOPE), ""),
    "a curve's class and a curve": (ACTIVE.format(SLOPE), ACTIVE.format(LONGEST)),
    "a class twice": (ACTIVE.format(SLOPE) + ACTIVE.format(SHORTEST), ACTIVE.format(LONGEST)),
    "another class of muscles": (MUSCLE.format(STRENGTH).replace("Millard2012Equilibrium", "Thelen2003"), ""),
    "no fibre damping": (MUSCLE.format(UNDAMPED), ""),
    "no fibre damping, a curve at speed": (
        MUSCLE.format(UNDAMPED + SPEED),
        ACTIVE.format("<minimum_value>0.2</minimum_value>"),
    ),
    "no fibre damping, a rigid tendon": (MUSCLE.format(UNDAMPED + RIGID), ""),
}
LEFT = ("optimal_fiber_length", "tendon_slack_length", "GeometryPath")
LEFT += ("pennation_angle_at_optimal", "maximum_pennation_angle")
"""Elements of the muscle that stay in its file."""


@pytest.mark.parametrize("curves", [ThelenCurves(), DeGrooteFreglyCurves(1.2, 0.5), SchutteCurves()])
def test_opensim_opens_the_muscles_that_are_written(curves: Any, tmp_path: Path) -> None:
    read = read_back(model_with(), tmp_path)
    steepest = read.muscles[0].maximum_pennation if isinstance(curves, ThelenCurves) else np.pi / 2
    muscle = replace(read.muscles[0], curves=curves, maximum_pennation=steepest, fiber_damping=0.0)
    muscle = replace(muscle, activation_time_constant=0.015, deactivation_time_constant=0.05)  # OpenSim's need them
    assert_opensim_opens(replace(read, muscles=(muscle,)), tmp_path)


@pytest.mark.parametrize("kind", CONSTRAINTS)
def test_opensim_opens_the_constraints_that_are_written(kind: str, tmp_path: Path) -> None:
    read = read_back(model_with(opensim.PlanarJoint), tmp_path)
    assert_opensim_opens(replace(read, constraints=(CONSTRAINTS[kind],)), tmp_path)


def assert_opensim_opens(model: Any, folder: Path) -> None:
    file = written(model, folder / "written.osim")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


# what stands in <defaults>, and what of the curves stands in the muscle itself


@pytest.fixture(autouse=True)
def _pristine() -> Iterator[None]:
    """OpenSim keeps the defaults of a file for every model that the process reads after it."""
    yield
    kinds = ["ActiveForceLengthCurve", "ForceVelocityCurve", "FiberForceLengthCurve", "CoordinateActuator", "Body"]
    for kind in (*kinds, "Millard2012EquilibriumMuscle", "Thelen2003Muscle"):
        opensim.OpenSimObject.registerType(getattr(opensim, kind)())


@pytest.mark.parametrize("name", CASES)
def test_a_muscle_is_what_opensim_makes_of_its_defaults(name: str, tmp_path: Path) -> None:
    defaults, own = CASES[name]
    ours, theirs = _read_by_both(tmp_path, defaults, own)
    index = ours.muscle_names.index("bare")
    muscle = opensim.Millard2012EquilibriumMuscle.safeDownCast(theirs.getMuscles().get("bare"))
    found = ours.muscles[index]
    assert found.max_isometric_force == muscle.getMaxIsometricForce()
    assert found.max_contraction_velocity == muscle.getMaxContractionVelocity()
    assert found.activation_time_constant == muscle.getActivationTimeConstant()
    assert vars(found.curves) == pytest.approx(vars(_curves_of(muscle)), rel=1e-12, abs=0)


def _curves_of(muscle: Any) -> MillardCurves:
    active, passive, speed = (
        muscle.getActiveForceLengthCurve(),
        muscle.getFiberForceLengthCurve(),
        muscle.getForceVelocityCurve(),
    )
    return MillardCurves(
        shortest=active.getMinActiveFiberLength(),
        transition=active.getTransitionFiberLength(),
        longest=active.getMaxActiveFiberLength(),
        shallow_slope=active.getShallowAscendingSlope(),
        minimum=active.getMinValue(),
        concentric_slope=speed.getConcentricSlopeAtVmax(),
        near_concentric_slope=speed.getConcentricSlopeNearVmax(),
        isometric_slope=speed.getIsometricSlope(),
        eccentric_slope=speed.getEccentricSlopeAtVmax(),
        near_eccentric_slope=speed.getEccentricSlopeNearVmax(),
        strongest=speed.getMaxEccentricVelocityForceMultiplier(),
        concentric_curviness=speed.getConcentricCurviness(),
        eccentric_curviness=speed.getEccentricCurviness(),
        passive_start=passive.getStrainAtZeroForce(),
        passive_end=passive.getStrainAtOneNormForce(),
        passive_low_slope=passive.getStiffnessAtLowForceInUse(),
        passive_slope=passive.getStiffnessAtOneNormForceInUse(),
        passive_curviness=passive.getCurvinessInUse(),
    )


def test_defaults_of_coordinates_actuators_and_bodies_count_and_those_of_a_set_do_not(tmp_path: Path) -> None:
    defaults = (
        "<CoordinateActuator name='default'><optimal_force>77</optimal_force><min_control>-0.5</min_control>"
        "</CoordinateActuator><Body name='default'><mass>5.5</mass></Body>"
    )
    motor = "<CoordinateActuator name='a'><coordinate>second_coord_0</coordinate></CoordinateActuator>"
    ours, theirs = _read_by_both(tmp_path, defaults, "", motor)
    assert [(each.optimal_force, each.min_control) for each in ours.actuators] == [(77.0, -0.5)]
    actuator = opensim.CoordinateActuator.safeDownCast(theirs.getForceSet().get("a"))
    assert (actuator.getOptimalForce(), actuator.getMinControl()) == (77.0, -0.5)
    for found in ours.bodies[1:]:
        assert found.mass == theirs.getBodySet().get(found.name).get_mass()


def _read_by_both(folder: Path, defaults: str, own: str, force: str = "") -> tuple[Any, Any]:
    """A model of two bodies with the muscle `bare`, whose element holds what is LEFT and `own`, in a file with these
    defaults: as read by the solver and by OpenSim.
    """
    built = model_with()
    span(built, opensim.Millard2012EquilibriumMuscle("bare", 300.0, 0.2, 0.15, 0.2))
    path = printed(built, folder / "defaults.osim")
    text = path.read_text(encoding="utf-8")
    start = text.index('<Millard2012EquilibriumMuscle name="bare">')
    end = text.index("</Millard2012EquilibriumMuscle>", start)
    kept = "".join(
        found[0] for tag in LEFT if (found := re.search(rf"<{tag}\b.*?</{tag}>", text[start:end], re.DOTALL))
    )
    text = text[:start] + f'<Millard2012EquilibriumMuscle name="bare">{kept}{own}' + text[end:]
    text = text.replace("</Millard2012EquilibriumMuscle>", f"</Millard2012EquilibriumMuscle>{force}", 1)
    text = re.sub(r"(<Model name=[^>]*>)", lambda found: found[0] + f"<defaults>{defaults}</defaults>", text, count=1)
    path.write_text(text, encoding="utf-8")
    return read_osim(path), opensim.Model(str(path))


@pytest.mark.parametrize(
    ("version", "pennation"),
    [(30000, "pennation_angle_at_optimal"), (20303, "pennation_angle_at_optimal"), (20001, "pennation_angle")],
)
def test_a_model_of_an_earlier_version_is_the_one_that_opensim_opens(
    tmp_path: Path, version: int, pennation: str
) -> None:
    file = tmp_path / "earlier.osim"
    file.write_text(opensim_3_document(version, pennation), encoding="utf-8")
    theirs, ours = opensim.Model(str(file)), read_osim(file)
    found = difference_to(theirs, ours)
    assert found.is_nought(), found
    muscle = theirs.getMuscles().get("pull")
    assert ours.muscles[0].pennation_at_optimal == muscle.get_pennation_angle_at_optimal() == 0.1
    marker = theirs.getMarkerSet().get("m")
    np.testing.assert_allclose(ours.markers[0].location, marker.get_location().to_numpy())


IDLE = '<Coordinate name="b"/><Coordinate name="idle"/>'
WINGING = """<thoracic_ellipsoid_radii_x_y_z>0.08 0.2 0.09</thoracic_ellipsoid_radii_x_y_z>
<scapula_winging_axis_origin>0.03 -0.02</scapula_winging_axis_origin>
<scapula_winging_axis_direction>0.4</scapula_winging_axis_direction>"""
OTHERS = "".join(f'<Coordinate name="{name}"/>' for name in ("d", "e", "f"))
AXIS = '<TransformAxis name="{}">.*?</TransformAxis>'
CHANGED = {
    "without rotation2": ((AXIS.format("rotation2"), ""),),
    "without translation3": ((AXIS.format("translation3"), ""),),
    "without both axes, which stand still": ((AXIS.format("rotation2"), ""), (AXIS.format("translation3"), "")),
    "scapulothoracic joint with its winging": (
        ('<PinJoint name="second">', f'<ScapulothoracicJoint name="second">{WINGING}'),
        ("</PinJoint>", "</ScapulothoracicJoint>"),
        ('<Coordinate name="c">', f'{OTHERS}<Coordinate name="c">'),
    ),
}


def changed_document(folder: Path, *changes: tuple[str, str]) -> Path:
    """A document of OpenSim 3 in which each pattern, which it has once, is replaced."""
    text, file = opensim_3_document(), folder / "earlier.osim"
    for pattern, new in changes:
        text, count = re.subn(pattern, new, text, flags=re.DOTALL)
        assert count == 1
    file.write_text(text, encoding="utf-8")
    return file


@pytest.mark.parametrize("changes", CHANGED.values(), ids=CHANGED)
def test_a_joint_of_an_earlier_version_is_the_one_that_opensim_opens(
    tmp_path: Path, changes: tuple[tuple[str, str], ...]
) -> None:
    file = changed_document(tmp_path, *changes)
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_a_coordinate_that_moves_no_axis_leaves_opensim_without_accelerations(tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    file = changed_document(tmp_path, ('<Coordinate name="b"/>', IDLE))
    model = opensim.Model(str(file))
    state = model.initSystem()
    model.realizeAcceleration(state)
    assert np.isnan([c.getAccelerationValue(state) for c in model.getCoordinateSet()]).all()
    with raises_refusal(SolverCode.UNSUPPORTED, naming="idle, which moves no axis"):
        read_osim(file)
