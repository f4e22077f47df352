"""The writer of .osim: read back it is the same model, and what it does not have is refused by name."""

import xml.etree.ElementTree as Xml
from dataclasses import fields, is_dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.constraint import (
    ConstantDistanceConstraint,
    CoordinateCoupler,
    CoordinateLock,
    CoordinatePrescription,
    PointOnLineConstraint,
    WeldConstraint,
)
from solver.errors import SolverCode
from solver.functions.coordinate_functions import (
    PiecewisePolynomial,
    Sine,
    natural_spline,
    piecewise_constant,
    piecewise_linear,
    polynomial,
    scaled,
    simm_spline,
    smooth_step,
)
from solver.functions.muscle_curves import DeGrooteFreglyCurves, SchutteCurves, ThelenCurves, ThelenTendon
from solver.model import BallMotion, Marker, Model
from solver.multibody.postures import rotation_body_fixed_xyz
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document, read_marker_set, with_markers
from solver.osim.tool_setups import read_ik_setup
from tests.refusals import raises_refusal

MODEL = bundled_model()
SHOULDER = MODEL.joint("GlenoHumeral")


def read_back(model: Model, folder: Path) -> Model:
    path = folder / "written.osim"
    Xml.ElementTree(osim_document(model)).write(path, encoding="utf-8")
    return read_osim(path)


def assert_same(ours: Any, theirs: Any, where: str = "model", rtol: float = 0.0, atol: float = 1e-15) -> None:
    """Field by field; rotations pass through three angles, so numbers of arrays may differ in the last digit."""
    assert type(ours) is type(theirs), where
    if is_dataclass(ours):
        for field in fields(ours):
            assert_same(getattr(ours, field.name), getattr(theirs, field.name), f"{where}.{field.name}", rtol, atol)
    elif isinstance(ours, tuple):
        assert len(ours) == len(theirs), where
        for index, (each, other) in enumerate(zip(ours, theirs, strict=True)):
            assert_same(each, other, f"{where}[{index}]", rtol, atol)
    elif isinstance(ours, np.ndarray) or (rtol and isinstance(ours, float)):
        np.testing.assert_allclose(theirs, ours, rtol=rtol, atol=atol, err_msg=where)
    else:
        assert ours == theirs, where


def test_the_bundled_model_comes_back_as_it_was_written(tmp_path: Path) -> None:
    """But with rigid tendons."""
    muscles = tuple(replace(muscle, tendon=None) for muscle in MODEL.muscles)
    assert_same(replace(MODEL, muscles=muscles), read_back(MODEL, tmp_path))


def with_shoulder(motion: Any) -> Model:
    joints = tuple(replace(each, motion=motion) if each.name == SHOULDER.name else each for each in MODEL.joints)
    return replace(MODEL, joints=joints)


def moved_by(function: Any) -> Any:
    """The shoulder's motion with this function on its driven axes."""
    motion: Any = SHOULDER.motion
    pairs = zip(motion.coordinate, motion.functions, strict=True)
    return replace(motion, functions=tuple(function if driver >= 0 else still for driver, still in pairs))


def with_first(model: Model, parts: str, place: int = 0, **changes: Any) -> Model:
    """With changes of one of its parts, the first if no place is given."""
    kept = getattr(model, parts)
    return replace(model, **{parts: (*kept[:place], replace(kept[place], **changes), *kept[place + 1 :])})


BALL = with_shoulder(BallMotion((12, 13, 14), ()))
CHANGED = {
    "limits": with_first(MODEL, "actuators", min_control=-2.0, max_control=3.0),
    "a higher polynomial": with_shoulder(moved_by(polynomial([0.1, 2.0, 3.0]))),
    "a clamped coordinate": with_first(MODEL, "coordinates", 3, is_clamped=True),
    "a coordinate that is neither angle nor distance": with_first(MODEL, "coordinates", 14, motion="coupled"),
    "a fixed marker": with_first(MODEL, "markers", is_fixed=True),
    "a ball": BALL,
    "a free joint": with_first(BALL, "joints", motion=BallMotion((0, 1, 2), (3, 4, 5))),
    "a torus": with_first(MODEL, "surfaces", kind="torus", dimensions=np.array([0.01, 0.06, 0.0])),
}


@pytest.mark.parametrize("name", CHANGED)
def test_what_is_changed_comes_back_too(name: str, tmp_path: Path) -> None:
    back = read_back(CHANGED[name], tmp_path)
    for part in ("joints", "surfaces", "actuators", "markers"):
        assert_same(getattr(CHANGED[name], part), getattr(back, part), part)
    if "polynomial" not in name:  # what it drives is neither angle nor distance
        assert_same(CHANGED[name].coordinates, back.coordinates)


def test_a_locked_coordinate_comes_back_with_its_value_as_default(tmp_path: Path) -> None:
    lock = CoordinateLock(MODEL.coordinate_names[5], 5, 0.25)
    back = read_back(replace(MODEL, constraints=(*MODEL.constraints, lock)), tmp_path)
    assert [each.value for each in back.constraints if isinstance(each, CoordinateLock)] == [0.25]
    assert back.coordinates[5].default == 0.25


MUSCLE = replace(MODEL.muscles[0], fiber_damping=0.0)
STEEPEST = {"maximum_pennation": np.pi / 2}
BENT = simm_spline(np.array([0.4, 0.8, 1.0, 1.6]), np.array([0.0, 0.7, 1.0, 0.0]))
THELEN = ThelenCurves(active_shape=0.5, strongest=1.6)
SCHUTTE = replace(MUSCLE, curves=SchutteCurves(BENT), **STEEPEST, max_contraction_velocity=8.0)
MUSCLES = {
    "Thelen": replace(MUSCLE, curves=THELEN, maximum_pennation=1.2, tendon=ThelenTendon(0.05)),
    "DeGrooteFregly": replace(MUSCLE, curves=DeGrooteFreglyCurves(1.2, 0.5, has_passive_force=False), **STEEPEST),
    "Schutte": SCHUTTE,
    "Schutte, activation never falls": replace(SCHUTTE, deactivation_time_constant=np.inf),
    "Schutte, activation never changes": replace(
        SCHUTTE, activation_time_constant=np.inf, deactivation_time_constant=np.inf
    ),
}
MUSCLES |= {
    f"{kind}, without activation dynamics": replace(
        MUSCLES[kind], activation_time_constant=0.0, deactivation_time_constant=0.0
    )
    for kind in ("Thelen", "DeGrooteFregly", "Schutte")
}


@pytest.mark.parametrize("kind", MUSCLES)
def test_muscles_come_back_as_their_class(kind: str, tmp_path: Path) -> None:
    back = read_back(replace(MODEL, muscles=(MUSCLES[kind],)), tmp_path).muscles[0]
    for field in fields(back):
        if field.name != "curves":
            assert_same(getattr(MUSCLES[kind], field.name), getattr(back, field.name), field.name)
    length, speed = np.linspace(0.3, 1.8, 50), np.linspace(-1.0, 1.0, 50)
    for curve, x in (("active_force_length", length), ("passive_force_length", length), ("force_velocity", speed)):
        np.testing.assert_allclose(getattr(back.curves, curve)(x), getattr(MUSCLES[kind].curves, curve)(x), atol=1e-12)


def test_constraints_come_back_too(tmp_path: Path) -> None:
    scapula, humerus = MODEL.body_index("scapula"), MODEL.body_index("humerus")
    places = (scapula, humerus, np.array([0.01, 0.0, 0.02]), np.array([0.0, 0.1, 0.0]))
    turned = rotation_body_fixed_xyz([0.1, 0.2, 0.3])
    constraints = (
        ConstantDistanceConstraint("strut", *places, 0.2),
        PointOnLineConstraint("slot", *places, np.array([0.6, 0.0, 0.8])),
        WeldConstraint("glue", *places, turned, np.eye(3)),
        CoordinateCoupler("follows", 6, (7,), (polynomial([0.1, 2.0]),)),
        CoordinateCoupler("follows_two", 8, (7, 9), (polynomial([0.1, 2.0]), polynomial([0.0, 3.0]))),
    )
    prescribed = CoordinatePrescription(MODEL.coordinate_names[15], 15, Sine(0.3, 2.0, 0.1, 0.2))
    back = read_back(replace(MODEL, constraints=(*constraints, prescribed)), tmp_path).constraints
    assert_same((prescribed, *constraints), back)


FLUTTER = PiecewisePolynomial(np.array([0.5]), np.zeros(2), np.array([[1.0, 2.0, 3.0], [0.0, -1.0, 0.0]]))


class Wind:
    name = "wind"


WAVY = simm_spline(np.array([-1.0, 0.0, 0.5, 2.0]), np.array([0.1, 0.4, 0.2, 0.7]))
THREE = np.array([-1.0, 0.0, 2.0]), np.array([0.1, 0.5, 0.3])
FUNCTIONS = {
    "Sine": Sine(1.0, 2.0, 0.3, 0.1),
    "SimmSpline": WAVY,
    "SimmSpline of three points": simm_spline(np.array([-1.0, 0.0, 0.5]), np.array([0.1, 0.4, 0.2])),
    "SimmSpline of two points": simm_spline(np.array([-1.0, 0.5]), np.array([0.1, 0.4])),
    "scaled SimmSpline": scaled(WAVY, 0.3),
    "PiecewiseLinearFunction": piecewise_linear(*THREE),
    "PiecewiseConstantFunction": piecewise_constant(*THREE),
    "StepFunction": smooth_step(0.2, 0.9, 0.1, 0.7),
    "StepFunction backwards": smooth_step(0.9, 0.2, 0.1, 0.7),
    "GCVSpline": natural_spline(np.linspace(-1.0, 1.0, 7), np.array([0.1, 0.5, 0.2, 0.3, 0.8, 0.1, 0.0]), 3),
    "GCVSpline of degree 3": natural_spline(np.linspace(-1.0, 1.0, 5), np.array([0.1, 0.5, 0.2, 0.3, 0.8]), 2),
}


@pytest.mark.parametrize("kind", FUNCTIONS)
def test_functions_come_back_as_their_class(kind: str, tmp_path: Path) -> None:
    changed = with_shoulder(moved_by(FUNCTIONS[kind]))
    assert ("LinearFunction" if "two points" in kind else kind.split()[-1 if "scaled" in kind else 0]) in (
        Xml.tostring(osim_document(changed), encoding="unicode")
    )
    back = next(joint for joint in read_back(changed, tmp_path).joints if joint.name == SHOULDER.name)
    q = np.linspace(-3.0, 4.0, 101)
    np.testing.assert_allclose(back.motion.functions[0].derivatives(q), FUNCTIONS[kind].derivatives(q), atol=1e-12)


@pytest.mark.parametrize(
    ("model", "name"),
    [(with_shoulder(moved_by(FLUTTER)), "GlenoHumeral.rotation1"), (replace(MODEL, forces=(Wind(),)), "for wind of")],
)
def test_what_the_writer_does_not_have_is_refused_by_name(model: Model, name: str) -> None:
    with raises_refusal(SolverCode.NOT_WRITABLE, naming=name):
        osim_document(model)


# Files of markers, of OpenSim 4 and 3, and tasks in a file of their own.


DOCUMENT = "<OpenSimDocument Version='{version}'><MarkerSet><objects>{markers}</objects></MarkerSet></OpenSimDocument>"
OLD = "<Marker name='C7'><body> thorax </body><location> 0 0.1 0 </location><fixed> true </fixed></Marker>"
NEW = (
    "<Marker name='C7'><socket_parent_frame>/bodyset/thorax</socket_parent_frame><location>0 0.1 0</location></Marker>"
)


def markers_in(folder: Path, text: str) -> Path:
    path = folder / "markers.xml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize(("version", "marker", "is_fixed"), [(30000, OLD, True), (40500, NEW, False)])
def test_a_marker_of_either_format_is_read_and_one_on_a_body_that_the_model_lacks_is_named(
    tmp_path: Path, version: int, marker: str, is_fixed: bool
) -> None:
    other = marker.replace("C7", "ASIS").replace("thorax", "pelvis")
    path = markers_in(tmp_path, DOCUMENT.format(version=version, markers=marker + other))
    (found,), unattached, unused = read_marker_set(path, MODEL)
    assert (unattached, unused) == (("ASIS",), ())
    expected = Marker("C7", MODEL.body_index("thorax"), np.array([0.0, 0.1, 0.0]), is_fixed)
    assert_same(found, expected, atol=0.0)
    model = with_markers(MODEL, [found])
    assert len(model.markers) == len(MODEL.markers) + 1
    assert_same(model.marker("C7"), expected, atol=0.0)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        ("<OpenSimDocument><Model/></OpenSimDocument>", SolverCode.WRONG_DOCUMENT),
        (
            DOCUMENT.format(version=30000, markers="<Marker name='C7'><location>0 0 0</location></Marker>"),
            SolverCode.UNKNOWN_NAME,
        ),
    ],
)
def test_a_file_that_does_not_fit_the_model_is_refused(tmp_path: Path, text: str, code: SolverCode) -> None:
    with raises_refusal(code):
        read_marker_set(markers_in(tmp_path, text), MODEL)


def test_tasks_may_be_in_a_file_of_their_own(tmp_path: Path) -> None:
    task = "<IKMarkerTask name='C7'><apply>true</apply><weight>2</weight></IKMarkerTask>"
    tasks = f"<OpenSimDocument><IKTaskSet><objects>{task}</objects></IKTaskSet></OpenSimDocument>"
    (tmp_path / "tasks.xml").write_text(tasks, encoding="utf-8")
    tool = "<InverseKinematicsTool><IKTaskSet file='tasks.xml'/></InverseKinematicsTool>"
    (tmp_path / "setup.xml").write_text(f"<OpenSimDocument>{tool}</OpenSimDocument>", encoding="utf-8")
    assert read_ik_setup(tmp_path / "setup.xml").markers == {"C7": 2.0}
