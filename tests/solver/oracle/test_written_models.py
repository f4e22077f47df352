"""Written forces, muscles and constraints, and defaults: OpenSim opens the file, with the same accelerations."""

from __future__ import annotations

import re
import xml.etree.ElementTree as Xml
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
from solver.osim.model_writer import osim_document
from tests.refusals import raises_refusal
from tests.solver.oracle.test_actuators import ADDED
from tests.solver.oracle.test_force_elements import FORCES, between_tilted_frames, constants
from tests.solver.oracle.test_muscles import span
from tests.solver.oracle.two_bodies import (
    difference_to,
    frame_of,
    given,
    model_with,
    opensim,
    read_back,
    vec3,
)
from tests.solver.osim.test_earlier_versions import opensim_3_document
from tests.solver.osim.test_model_writer import assert_same

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


def springs_of_coordinates(model: Any) -> None:
    spring = opensim.SpringGeneralizedForce("first_coord_0")
    spring.setStiffness(7.0)
    spring.setRestLength(0.3)
    spring.setViscosity(0.4)
    formula = opensim.ExpressionBasedCoordinateForce("first_coord_1", "-2*q^3 - 0.5*qdot")
    for force in (spring, formula, opensim.CoordinateLimitForce("second_coord_0", 20.0, 0.2, -15.0, 0.3, 0.01, 30.0)):
        model.addForce(given(force))


def along_paths(model: Any) -> None:
    kinds = "spring along a path", "formula along a path, clamped: True", "ligament", "Blankevoort's ligament of 0.4 m"
    for index, kind in enumerate(kinds):
        FORCES[kind](model).setName(f"force_{index}")


def bushings(model: Any) -> None:
    linear = opensim.BushingForce()
    linear.set_rotational_stiffness(vec3(3, 5, 7))
    linear.set_translational_stiffness(vec3(30, 50, 70))
    curved = opensim.FunctionBasedBushingForce()
    curved.set_m_x_theta_x_function(opensim.Sine(20.0, 2.0, 0.1))
    spline = opensim.SimmSpline()
    for x, y in ((-1.0, -4.0), (0.0, 0.0), (0.3, 2.0), (1.0, 9.0)):
        spline.addPoint(x, y)
    curved.set_f_y_delta_y_function(spline)
    formula = opensim.ExpressionBasedBushingForce()
    formula.setMyExpression("5*theta_z*delta_x")
    for index, bushing in enumerate((linear, curved, formula)):
        bushing.setName(f"bushing_{index}")
        bushing.set_rotational_damping(vec3(0.2, 0.3, 0.4))
        if index:
            bushing.updSocket("frame1").connect(frame_of(model, "upper"))
            bushing.updSocket("frame2").connect(frame_of(model, "lower"))
            model.addForce(given(bushing))
        else:
            between_tilted_frames(model, bushing)


def at_points(model: Any) -> None:
    ends = (frame_of(model, "upper"), vec3(0.2, 0.1, 0), frame_of(model, "lower"), vec3(0, -0.1, 0.3))
    spring = opensim.PointToPointSpring(*ends, 200.0, 0.5)
    spring.setName("spring")
    formula = opensim.ExpressionBasedPointToPointForce("upper", ends[1], "lower", ends[3], "20/d^2 + 3*ddot")
    formula.setName("charge")
    weight = opensim.PrescribedForce("weight", frame_of(model, "lower"))
    weight.setForceFunctions(*constants(3, -20, 5))
    weight.setPointFunctions(*constants(0.1, 0.2, -0.1))
    weight.setTorqueFunctions(*constants(1, 0, -2))
    for force in (spring, formula, weight):
        model.addForce(given(force))


def contacts(model: Any) -> None:
    FORCES["smooth contact with dissipation"](model)
    hard = opensim.HuntCrossleyForce()
    hard.setName("hard")
    hard.addGeometry("floor")
    hard.addGeometry("heel")
    hard.setStiffness(1e6)
    hard.setDissipation(0.5)
    hard.setStaticFriction(0.8)
    model.addForce(given(hard))


def actuators(model: Any) -> None:
    for index, (kind, add) in enumerate(ADDED.items()):
        if "offset" not in kind:
            add(model).setName(f"added_{index}")


KINDS = {
    "springs of coordinates": springs_of_coordinates,
    "along paths": along_paths,
    "bushings": bushings,
    "at points": at_points,
    "contacts": contacts,
    "actuators": actuators,
}


@pytest.mark.parametrize("kind", KINDS)
def test_opensim_opens_the_forces_that_are_written(kind: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint if "coordinates" in kind else opensim.UniversalJoint)
    KINDS[kind](model)
    read = read_back(model, tmp_path)
    file = tmp_path / "written.osim"
    Xml.ElementTree(osim_document(read)).write(file, encoding="utf-8")
    again = read_osim(file)
    assert_same((read.forces, read.actuators, read.coordinate_forces), again_parts(again))
    assert difference_to(opensim.Model(str(file)), again).is_nought()
    assert difference_to(model, again).is_nought()


def again_parts(model: Any) -> tuple[Any, ...]:
    return model.forces, model.actuators, model.coordinate_forces


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
    file = folder / "written.osim"
    Xml.ElementTree(osim_document(model)).write(file, encoding="utf-8")
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
    ours, theirs = _read_by_both(
        tmp_path, defaults, "", "<CoordinateActuator name='a'><coordinate>c</coordinate></CoordinateActuator>"
    )
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
    built.finalizeConnections()
    path = folder / "defaults.osim"
    built.printToXML(str(path))
    text = path.read_text(encoding="utf-8")
    start = text.index('<Millard2012EquilibriumMuscle name="bare">')
    end = text.index("</Millard2012EquilibriumMuscle>", start)
    kept = "".join(
        found[0] for tag in LEFT if (found := re.search(rf"<{tag}\b.*?</{tag}>", text[start:end], re.DOTALL))
    )
    text = text[:start] + f'<Millard2012EquilibriumMuscle name="bare">{kept}{own}' + text[end:]
    coordinate = re.search(r'<Coordinate name="([^"]+)"', text)
    force = force.replace(">c<", f">{coordinate[1]}<")
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


@pytest.mark.parametrize("lacking", [("rotation2",), ("translation3",), ("rotation2", "translation3")])
def test_an_axis_that_the_file_does_not_list_stands_still(tmp_path: Path, lacking: tuple[str, ...]) -> None:
    file = tmp_path / "earlier.osim"
    text = opensim_3_document()
    for name in lacking:
        text, count = re.subn(rf'<TransformAxis name="{name}">.*?</TransformAxis>', "", text, flags=re.DOTALL)
        assert count == 1
    file.write_text(text, encoding="utf-8")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_a_scapulothoracic_joint_keeps_its_winging(tmp_path: Path) -> None:
    own = """<thoracic_ellipsoid_radii_x_y_z>0.08 0.2 0.09</thoracic_ellipsoid_radii_x_y_z>
<scapula_winging_axis_origin>0.03 -0.02</scapula_winging_axis_origin>
<scapula_winging_axis_direction>0.4</scapula_winging_axis_direction>"""
    others = "".join(f'<Coordinate name="{name}"/>' for name in ("d", "e", "f"))
    text = opensim_3_document().replace('<PinJoint name="second">', f'<ScapulothoracicJoint name="second">{own}')
    text = text.replace("</PinJoint>", "</ScapulothoracicJoint>")
    text = text.replace('<Coordinate name="c">', f'{others}<Coordinate name="c">')
    file = tmp_path / "earlier.osim"
    file.write_text(text, encoding="utf-8")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


def test_a_coordinate_that_moves_no_axis_leaves_opensim_without_accelerations(tmp_path: Path) -> None:
    # where this fails, OpenSim has mended it, and the solver can read it
    file = tmp_path / "earlier.osim"
    idle = '<Coordinate name="b"/><Coordinate name="idle"/>'
    file.write_text(opensim_3_document().replace('<Coordinate name="b"/>', idle), encoding="utf-8")
    model = opensim.Model(str(file))
    state = model.initSystem()
    model.realizeAcceleration(state)
    assert np.isnan([c.getAccelerationValue(state) for c in model.getCoordinateSet()]).all()
    with raises_refusal(SolverCode.UNSUPPORTED, naming="idle, which moves no axis"):
        read_osim(file)
