"""Scaling at random factors against OpenSim: models and their forces; set-ups that we write, run by OpenSim."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc, write_trc
from solver.bundled import bundled_model
from solver.constraint import Constraint, CoordinateCoupler, WeldConstraint
from solver.errors import SolverCode
from solver.inverse_kinematics.solve import solve_inverse_kinematics
from solver.model import AnyPathPoint, Array, AxisMotion, Marker, Model, MovingPathPoint, ScapulothoracicMotion
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import read_marker_set
from solver.osim.tool_setups import (
    CoordinateTask,
    IkSetup,
    Measurement,
    ScaleSetup,
    ik_setup_document,
    read_ik_setup,
    read_scale_setup,
    scale_setup_document,
)
from solver.scaling import Scaling, scale_model, scale_skeleton
from solver.time_series_table import read_table
from tests.refusals import raises_refusal
from tests.solver.inverse_kinematics.marked import random_postures, seen_from
from tests.solver.oracle.test_actuators import ADDED
from tests.solver.oracle.test_force_elements import COORDINATE_FORCES, FORCES
from tests.solver.oracle.test_joints import coupler
from tests.solver.oracle.two_bodies import (
    force_parts,
    frame_of,
    given,
    made,
    model_with,
    opensim,
    printed,
    read_back,
    vec3,
    written,
)
from tests.solver.osim.test_model_writer import assert_same

MODEL = bundled_model()
NAMES = [marker.name for marker in MODEL.markers]
FACTORS = {
    "ground": np.array([1.1, 0.95, 1.2]),
    "upper": np.array([1.2, 0.9, 1.1]),
    "lower": np.array([0.8, 1.3, 1.05]),
}


@pytest.mark.parametrize(
    ("seed", "mass", "keeps_masses"), [(1, None, False), (2, 35.0, False), (1, 35.0, True), (2, None, True)]
)
def test_a_scaled_model_is_opensims(seed: int, mass: float | None, keeps_masses: bool, tmp_path: Path) -> None:
    """OpenSim leaves joined points where they were, and prints coefficients of moving points with six digits."""
    generic = read_osim(written(bundled_model(), tmp_path / "generic.osim"))
    chance = np.random.default_rng(seed)
    factors = {body.name: chance.uniform(0.85, 1.2, 3) for body in generic.bodies[1:]}
    theirs = scaled_by_opensim(tmp_path, factors, mass, keeps_masses)
    ours = scale_model(generic, Scaling(factors, mass, keeps_masses, scales_joined_points=False))
    for part in ("bodies", "surfaces", "constraints", "markers"):
        assert_same(getattr(ours, part), getattr(theirs, part), part, rtol=1e-12, atol=1e-12)
    for one, other in zip(ours.joints, theirs.joints, strict=True):
        for side in ("frame_in_parent", "frame_in_child"):
            np.testing.assert_allclose(getattr(one, side).translation, getattr(other, side).translation, atol=1e-12)
        if isinstance(one.motion, ScapulothoracicMotion):
            assert_same(one.motion, other.motion, one.name, rtol=1e-12, atol=1e-12)
    for one, other in zip(ours.muscles, theirs.muscles, strict=True):
        assert one.optimal_fiber_length == pytest.approx(other.optimal_fiber_length, rel=1e-6)
        assert one.tendon_slack_length == pytest.approx(other.tendon_slack_length, rel=1e-6)
        for point, same in zip(one.path.points, other.path.points, strict=True):
            is_printed = isinstance(point, MovingPathPoint)
            np.testing.assert_allclose(places_of(point), places_of(same), atol=1e-6 if is_printed else 1e-12)


def test_the_frames_of_a_weld_are_scaled(tmp_path: Path) -> None:
    model = model_with(opensim.FreeJoint)
    ends = [(frame_of(model, "ground"), vec3(0.1, 0.2, -0.1)), (frame_of(model, "lower"), vec3(0.05, -0.1, 0.2))]
    weld = opensim.WeldConstraint("weld", *ends[0], vec3(0.3, -0.2, 0.4), *ends[1], vec3(0.0, 0.0, 0.0))
    model.addConstraint(given(weld))
    found, theirs = scaled_constraints(model, "lower", (1.1, 0.9, 1.2), tmp_path)
    assert isinstance(found, WeldConstraint)
    assert_same(found, theirs)
    assert not np.allclose(found.location_2, [0.05, -0.1, 0.2])


@pytest.mark.parametrize("dependent", ["first_coord_1", "second_coord_0"])  # a distance, an angle
def test_a_coupled_distance_is_scaled(dependent: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    model.addConstraint(coupler(["first_coord_0"], dependent, opensim.Sine(0.3, 1.5, 0.2)))
    found, theirs = scaled_constraints(model, "ground", (1.2, 1.2, 1.2), tmp_path)
    assert isinstance(theirs, CoordinateCoupler)
    assert isinstance(found, CoordinateCoupler)
    x = np.linspace(-1.0, 1.0, 5)
    for one, other in zip(found.functions[0].derivatives(x), theirs.functions[0].derivatives(x), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-14)
    if dependent == "first_coord_1":
        with raises_refusal(SolverCode.UNSUPPORTED, naming="couples a distance"):
            scaled_constraints(model, "ground", (1.2, 1.1, 1.2), tmp_path)


def scaled_constraints(
    model: Any, body: str, factors: tuple[float, float, float], folder: Path
) -> tuple[Constraint, Constraint]:
    """The only constraint of the model as scaled by the solver, and by OpenSim, where one body is scaled."""
    ours = read_back(model, folder)
    found = scale_skeleton(ours, Scaling({body: factors})).constraints[0]
    model.scale(model.initSystem(), scale_set({body: factors}), True)
    return found, read_back(model, folder).constraints[0]


def scale_set(factors: Mapping[str, Sequence[float]]) -> Any:
    scales = opensim.ScaleSet()
    for name, factor in factors.items():
        scales.cloneAndAppend(made("Scale", "", setSegmentName=name, setScaleFactors=vec3(*factor), setApply=True))
    return scales


def places_of(point: AnyPathPoint) -> np.ndarray:
    """(places, 3) of a path point in its body, at five values of the coordinate that moves it."""
    if not isinstance(point, MovingPathPoint):
        return point.location[None]
    values = np.linspace(0.1, 0.5, 5)
    local = np.stack([function.derivatives(values)[0] for function in point.functions], axis=1)
    return point.placement.translation + local @ point.placement.rotation.T


def test_a_joint_that_slides_by_a_function_slides_by_as_much_as_opensims(tmp_path: Path) -> None:
    """Functions of translations are scaled along their axes; a plain degree of freedom has no size."""
    model = model_with(sliding)
    model.initSystem()
    factors = {name: FACTORS[name] for name in ("ground", "upper")}
    generic = read_osim(printed(model, tmp_path / "generic.osim"))
    ours = scale_model(generic, Scaling(factors, scales_joined_points=False))
    theirs = scaled_by_opensim(tmp_path, factors, None, False)
    q = np.array([-0.7, 0.2, 1.1])
    for one, other in zip(ours.joints, theirs.joints, strict=True):
        assert isinstance(one.motion, AxisMotion)
        assert isinstance(other.motion, AxisMotion)
        for function, same in zip(one.motion.functions, other.motion.functions, strict=True):
            np.testing.assert_allclose(function.derivatives(q)[0], same.derivatives(q)[0], atol=1e-12)


def sliding(*sides: Any) -> Any:
    """A custom joint: `turn` turns about x and slides along an oblique axis, `lift` slides along y."""
    transform = opensim.SpatialTransform()
    for index, driver, slope, axis in (
        (0, "turn", 1.0, (1, 0, 0)),
        (3, "turn", 0.4, (0.6, 0, -0.8)),
        (4, "lift", 1.0, (0, 1, 0)),
    ):
        moved = transform.updTransformAxis(index)
        moved.setAxis(vec3(*axis))
        moved.setCoordinateNames(opensim.ArrayStr(driver, 1))
        moved.set_function(opensim.LinearFunction(slope, 0.0 if slope == 1.0 else 0.1))
    return opensim.CustomJoint(*sides, transform)


def scaled_by_opensim(folder: Path, factors: Mapping[str, Any], mass: float | None, keeps_masses: bool) -> Model:
    model = opensim.Model(str(folder / "generic.osim"))
    state = model.initSystem()
    assert model.scale(state, scale_set(factors), keeps_masses, -1.0 if mass is None else mass)
    return read_osim(printed(model, folder / "scaled.osim"))


@pytest.fixture
def files(tmp_path: Path) -> Path:
    """A folder with generic.osim and trial.trc, whose markers are displaced by centimetres."""
    written(MODEL, tmp_path / "generic.osim")
    first, last = random_postures(MODEL, 2, 0.1, 3)
    part = np.linspace(0.0, 1.0, 6)[:, None]
    displaced = np.random.default_rng(4).uniform(-0.01, 0.01, (1, len(NAMES), 3))
    positions = 1e3 * (seen_from(MODEL, first + part * (last - first)) + displaced)
    table = MarkerTable(tuple(NAMES), 100.0, np.arange(6) / 100, positions, np.zeros(positions.shape[:2]))
    (tmp_path / "trial.trc").write_text(write_trc(table, "trial.trc"), encoding="utf-8")
    return tmp_path


def markers_of(folder: Path) -> Array:
    return 1e-3 * read_trc(folder / "trial.trc").positions


def write(path: Path, root: ElementTree.Element) -> Path:
    ElementTree.ElementTree(root).write(path, encoding="utf-8", xml_declaration=True)
    return path


def test_opensim_solves_our_set_up_of_inverse_kinematics_to_our_optimum(
    files: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(files)  # OpenSim seeks the model of this tool, unlike that of others, in the working folder
    weights = {name: 1.0 + k % 3 for k, name in enumerate(NAMES)}
    tasks = {"clav_elev": CoordinateTask(1e-3, 0.1), "scapula_winging": CoordinateTask(1e-4, None, is_default=True)}
    setup = IkSetup((0.0, 0.05), weights, tasks, files / "generic.osim", files / "trial.trc", None)
    path = write(files / "ik.xml", ik_setup_document(setup, files, "theirs.mot"))
    assert read_ik_setup(path) == setup

    tool = opensim.InverseKinematicsTool(str(path))
    tool.setResultsDir(str(files))
    tool.set_accuracy(1e-9)
    tool.set_report_errors(False)
    assert tool.run()
    columns, table, _ = read_table(files / "theirs.mot")
    scale = [np.pi / 180 if each.motion == "rotation" else 1.0 for each in MODEL.coordinates]
    theirs = table[:, [columns.index(name) for name in MODEL.coordinate_names]] * scale
    followed = setup.tasks(MODEL, NAMES, np.arange(6) / 100)
    ours = solve_inverse_kinematics(MODEL, markers_of(files), followed)
    assert ours.unsolved == 0
    held = [k for k, name in enumerate(MODEL.coordinate_names) if name not in ("elbow_flexion", "pro_sup")]
    np.testing.assert_allclose(theirs[:, held], ours.coordinates[:, held], atol=2e-5)


def test_opensim_scales_by_our_set_up_as_we_do(files: Path) -> None:
    measurement = Measurement("arm", (("EpL", "gu"), ("EpM", "gu")), {"humerus": (1,), "ulna": (0, 1)})
    manual = {"clavicle": np.array([1.1, 1.0, 0.9]), "scapula": np.array([1.05, 1.05, 1.05])}
    order, paths = ("measurements", "manualScale"), (files / "trial.trc", files / "generic.osim")
    setup = ScaleSetup((measurement,), manual, order, None, False, (0.0, 0.05), *paths, None)
    path = write(files / "scale.xml", scale_setup_document(setup, files, "theirs.osim"))
    back = read_scale_setup(path)
    assert replace(back, manual={}) == replace(setup, manual={})
    assert {body: list(factors) for body, factors in back.manual.items()} == {
        body: list(factors) for body, factors in manual.items()
    }
    assert opensim.ScaleTool(str(path)).run()
    theirs = read_osim(files / "theirs.osim")
    factors = setup.factors(MODEL, NAMES, markers_of(files))
    ours = scale_model(MODEL, Scaling(factors, scales_joined_points=False))
    for body in ("humerus", "ulna", "clavicle", "scapula"):
        k = MODEL.body_index(body)
        np.testing.assert_allclose(theirs.bodies[k].mass_center, ours.bodies[k].mass_center, atol=1e-12)
        np.testing.assert_allclose(theirs.bodies[k].inertia, ours.bodies[k].inertia, rtol=1e-9, atol=1e-15)
    humerus = [marker.location[1] for marker in theirs.markers if marker.name == "EpL"]
    assert humerus == pytest.approx([ours.marker("EpL").location[1]], abs=1e-9)


MARKER_SET = """<OpenSimDocument Version="40000"><MarkerSet name="markerset"><objects>
    <Marker name="ACv">
        <socket_parent_frame>/bodyset/scapula</socket_parent_frame>
        <location>-0.02 0.01 0.003</location><fixed>true</fixed>
    </Marker>
    <Marker name="c7">
        <socket_parent_frame>/bodyset/thorax</socket_parent_frame>
        <location>-0.1 0.03 0</location><fixed>false</fixed>
    </Marker>
</objects></MarkerSet></OpenSimDocument>"""


def test_opensim_reads_a_marker_set_as_we_do(files: Path) -> None:
    added = (
        Marker("ACv", MODEL.body_index("scapula"), np.array([-0.02, 0.01, 0.003]), is_fixed=True),
        Marker("c7", MODEL.body_index("thorax"), np.array([-0.1, 0.03, 0.0])),
    )
    path, printed_again = files / "markers.xml", files / "printed.xml"
    path.write_text(MARKER_SET, encoding="utf-8")
    model = opensim.Model(str(files / "generic.osim"))
    model.updateMarkerSet(opensim.MarkerSet(str(path)))
    model.initSystem()
    theirs = model.getMarkerSet().get("ACv")
    assert theirs.getParentFrame().getName() == "scapula"
    assert theirs.get_location().to_numpy().tolist() == added[0].location.tolist()
    assert model.getMarkerSet().getSize() == len(NAMES) + 1
    opensim.MarkerSet(str(path)).printToXML(str(printed_again))
    for file in (path, printed_again):
        assert_same(tuple(read_marker_set(file, MODEL)[0]), added, rtol=1e-15)


ALONG_PATHS = (
    "spring along a path",
    "ligament",
    "Blankevoort's ligament of 0.4 m",
    "formula along a path, clamped: True",
)
BUSHINGS = "bushing", "bushing of functions", "bushing of expressions"


def at_coordinate(kind: str, coordinate: str) -> Callable[[Any], Any]:
    return lambda model: model.addForce(given(COORDINATE_FORCES[kind](coordinate)))


SCALED: dict[str, list[Callable[[Any], Any]]] = {
    "coordinates": [
        at_coordinate("spring", "first_coord_0"),
        at_coordinate("formula", "first_coord_1"),
        at_coordinate("limit of an angle", "second_coord_0"),
    ],
    "along paths": [FORCES[kind] for kind in ALONG_PATHS],
    "bushings": [FORCES[kind] for kind in BUSHINGS],
    "spring between points": [FORCES["spring between points"]],
    "formula between points": [FORCES["formula between points"]],
    "constant force": [FORCES["constant force, global axes, local point, body"]],
    "smooth contact": [FORCES["smooth contact with dissipation"]],
    "hard contact": [FORCES["hard contact"]],
    "actuators": [add for kind, add in ADDED.items() if "offset" not in kind],
}


@pytest.mark.parametrize("kind", SCALED)
def test_forces_are_scaled_as_by_opensim(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint if kind == "coordinates" else opensim.UniversalJoint)
    for add in SCALED[kind]:
        add(model)
    for index, force in enumerate(model.getForceSet()):
        force.setName(f"force_{index}")
    model.finalizeConnections()
    model.initSystem()
    generic = printed(model, tmp_path / "generic.osim")
    before = read_osim(generic)
    ours = scale_model(before, Scaling(FACTORS, scales_joined_points=False))
    theirs = scaled_by_opensim(tmp_path, FACTORS, None, False)
    assert_same(force_parts(ours), force_parts(theirs), rtol=1e-12)
    if kind == "along paths":
        pairs = zip(ours.forces, before.forces, strict=True)
        changes = [abs(one.resting_length / other.resting_length - 1.0) for one, other in pairs]
        assert len(changes) == len(ALONG_PATHS) and min(changes) > 0.01
    elif kind == "bushings":
        assert len(ours.forces) == len(BUSHINGS)
        for one, other in zip(ours.forces, before.forces, strict=True):
            assert not np.allclose(one.frame_1.translation, other.frame_1.translation)
    elif kind == "actuators":
        assert not np.allclose(ours.actuators[0].path.points[1].location, before.actuators[0].path.points[1].location)
    else:  # OpenSim leaves points and contacts where they were
        assert_same(force_parts(ours), force_parts(before), rtol=1e-2)
