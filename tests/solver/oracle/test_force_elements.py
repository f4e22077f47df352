"""Springs, bushings, ligaments, contact and forces of a formula against OpenSim: they count in every acceleration."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.functions.coordinate_functions import Expression
from solver.osim.model_reader import read_osim
from tests.solver.oracle.test_paths import path_of, tilted
from tests.solver.oracle.two_bodies import (
    Difference,
    difference,
    difference_to,
    frame_of,
    given,
    model_with,
    opensim,
    random_states,
    read_back,
    solvers_values,
    vec3,
)

DAMPING = (vec3(2, 3, 4), vec3(0.2, 0.3, 0.1))
FORMULAS = [
    "-q^2^0.5 + 2--q*3/4-1e-1 + .5*5.",
    "sqrt(abs(q))+log(2+abs(qdot))+exp(-q)",
    "sin(q)*cos(q)+tan(q)-sec(q)/csc(q)+cot(1+abs(q))",
    "asin(q/9)+acos(q/9)+atan(q)*sinh(q)-cosh(q)*tanh(q)",
    "erf(q)-erfc(qdot)",
    "step(q)+delta(q)*3+square(q)-cube(qdot)+recip(2+q*q)",
    "min(q,qdot)*max(q,0.1)-abs(q)",
    "a*q+b; a=b*2; b=qdot",
    "-(q-1)^2/-2*3",
]


def test_a_bushing_holds_two_frames_together(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    frames = [opensim.PhysicalOffsetFrame(name, frame_of(model, name), tilted()) for name in ("upper", "lower")]
    for frame, name in zip(frames, ("upper", "lower"), strict=True):
        frame.setName(f"{name}_tilted")
        frame_of(model, name).addComponent(given(frame))
    model.finalizeConnections()
    stiffness, damping = (vec3(300, 500, 700), vec3(3, 5, 7)), (vec3(2, 3, 4), vec3(0.2, 0.3, 0.1))
    model.addForce(given(opensim.BushingForce("bushing", *frames, *stiffness, *damping)))
    assert counted(model, tmp_path).is_nought()


def test_a_spring_along_a_path_pulls_beyond_its_resting_length(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    spring = opensim.PathSpring("spring", 0.5, 800.0, 0.3)
    model.addForce(given(spring))
    lay(model, spring)
    assert counted(model, tmp_path).is_nought()


@pytest.mark.parametrize("has_own_curve", [False, True])
def test_a_ligament_pulls_by_its_curve(has_own_curve: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    ligament = opensim.Ligament()
    ligament.setName("ligament")
    ligament.setRestingLength(0.5)
    ligament.setMaxIsometricForce(120.0)
    if has_own_curve:
        curve = opensim.SimmSpline()
        for x, y in ((0.9, 0.0), (1.0, 0.0), (1.1, 0.2), (1.3, 1.5), (1.6, 4.0)):
            curve.addPoint(x, y)
        ligament.setForceLengthCurve(curve)
    model.addForce(given(ligament))
    lay(model, ligament)
    assert counted(model, tmp_path).is_nought()


def test_the_curve_of_a_ligament_may_be_within_its_property_as_in_earlier_files(tmp_path: Path) -> None:
    model, file = model_with(opensim.UniversalJoint), tmp_path / "ligament.osim"
    ligament = opensim.Ligament()
    ligament.setName("ligament")
    ligament.setRestingLength(0.5)
    ligament.setMaxIsometricForce(120.0)
    ligament.setForceLengthCurve(opensim.SimmSpline())
    model.addForce(given(ligament))
    lay(model, ligament)
    model.finalizeConnections()
    model.printToXML(str(file))
    curve = "<force_length_curve><SimmSpline><x>1 1.1 1.2 1.5</x><y>0 0.3 0.5 4</y></SimmSpline></force_length_curve>"
    own = re.compile(r'<SimmSpline name="force_length_curve">.*?</SimmSpline>', re.DOTALL)
    text, count = own.subn(curve, file.read_text())
    assert count == 1
    file.write_text(text)
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


@pytest.mark.parametrize("kinds", ["floor and two spheres", "two spheres", "one material"])
def test_contact_of_spheres_and_a_half_space(kinds: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    floor = opensim.ContactHalfSpace(vec3(0.1, -0.3, 0), vec3(0.1, 0.2, -1.4), model.getGround(), "floor")
    heel = opensim.ContactSphere(0.1, vec3(0.02, -0.15, 0.01), frame_of(model, "lower"), "heel")
    toe = opensim.ContactSphere(0.36, vec3(-0.1, -0.05, 0.05), frame_of(model, "upper"), "toe")
    shapes = {"floor and two spheres": [floor, heel, toe], "two spheres": [heel, toe], "one material": [floor, heel]}
    for shape in shapes[kinds]:
        model.addContactGeometry(given(shape))
    force = opensim.HuntCrossleyForce()
    force.setName("contact")
    force.setTransitionVelocity(0.2)
    force.addGeometry("heel")
    model.addForce(given(force))
    materials = [(1e6, 0.5, 0.9, 0.6, 0.2), (3e5, 1.0, 0.7, 0.3, 0.0), (5e5, 0.0, 0.0, 0.0, 0.0)]
    used = materials[:1] * 3 if kinds == "one material" else materials
    groups = [group(shape.getName(), *figures) for shape, figures in zip(shapes[kinds], used, strict=False)]
    file = tmp_path / "contact.osim"
    model.finalizeConnections()
    model.printToXML(str(file))
    one = re.compile(r"<HuntCrossleyForce::ContactParameters>.*</HuntCrossleyForce::ContactParameters>", re.DOTALL)
    file.write_text(one.sub("".join(groups), file.read_text()))
    assert counted(opensim.Model(str(file)), tmp_path).is_nought()


@pytest.mark.parametrize("dissipation", [0.0, 1.2])
def test_smooth_contact_of_a_sphere_and_a_half_space(dissipation: float, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    floor = opensim.ContactHalfSpace(vec3(0.1, -0.3, 0), vec3(0.1, 0.2, -1.4), model.getGround(), "floor")
    heel = opensim.ContactSphere(0.1, vec3(0.02, -0.15, 0.01), frame_of(model, "lower"), "heel")
    for shape in (floor, heel):
        model.addContactGeometry(given(shape))
    force = opensim.SmoothSphereHalfSpaceForce("smooth", heel, floor)
    figures = {"stiffness": 1e6, "dissipation": dissipation, "static_friction": 0.9, "dynamic_friction": 0.6}
    figures |= {"viscous_friction": 0.2, "transition_velocity": 0.2, "constant_contact_force": 2e-5}
    figures |= {"hertz_smoothing": 200.0, "hunt_crossley_smoothing": 40.0}
    for name, figure in figures.items():
        getattr(force, f"set_{name}")(figure)
    model.addForce(given(force))
    assert counted(model, tmp_path).is_nought()


def group(geometry: str, *figures: float) -> str:
    """The Python interface of OpenSim has one group of contact parameters only."""
    names = ("stiffness", "dissipation", "static_friction", "dynamic_friction", "viscous_friction")
    values = "".join(f"<{name}>{figure}</{name}>" for name, figure in zip(names, figures, strict=True))
    tag = "HuntCrossleyForce::ContactParameters"
    return f"<{tag}><geometry>{geometry}</geometry>{values}</{tag}>"


def test_what_is_switched_off_does_not_act_and_is_named(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    model.addForce(given(opensim.PathSpring("spring", 0.1, 800.0, 0.3)))
    spring = opensim.PathSpring.safeDownCast(model.updForceSet().get("spring"))
    lay(model, spring)
    spring.set_appliesForce(False)
    point = opensim.PointConstraint(frame_of(model, "ground"), vec3(0, 0, 0), frame_of(model, "lower"), vec3(0, 0, 0))
    point.setName("held")
    point.set_isEnforced(False)
    model.addConstraint(given(point))
    ours = read_back(model, tmp_path)
    assert ours.left_out == ("PathSpring spring", "PointConstraint held")
    assert difference_to(model, ours).is_nought()


def test_a_body_without_mass_has_no_inertia(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    frame_of(model, "upper").setMass(0.0)
    ours = read_back(model, tmp_path)
    assert not ours.bodies[1].inertia.any()
    assert difference_to(model, ours).is_nought()


def lay(model: Any, force: Any) -> None:
    path = path_of(force)
    path.appendNewPathPoint("start", frame_of(model, "ground"), vec3(0.3, 0.2, -0.1))
    path.appendNewPathPoint("end", frame_of(model, "lower"), vec3(0.02, -0.2, 0.1))


def counted(model: Any, folder: Path) -> Difference:
    """The difference, of a force that changes accelerations in several of the postures."""
    ours = read_back(model, folder)
    states = random_states(ours)
    without = replace(ours, forces=())
    change = solvers_values(ours, *states)["acceleration"] - solvers_values(without, *states)["acceleration"]
    assert (np.abs(change).max(axis=1) > 1.0).sum() > 3
    return difference_to(model, ours)


def constants(*values: float) -> list[Any]:
    return [opensim.Constant(float(value)) for value in values]


def between_tilted_frames(model: Any, bushing: Any) -> None:
    """Connect a bushing to frames that are tilted in both bodies."""
    for number, name in ((1, "upper"), (2, "lower")):
        frame = opensim.PhysicalOffsetFrame(f"{name}_tilted", frame_of(model, name), tilted())
        frame_of(model, name).addComponent(given(frame))
        bushing.updSocket(f"frame{number}").connect(frame)
    model.addForce(given(bushing))


def test_a_bushing_of_functions(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    bushing = opensim.FunctionBasedBushingForce()
    bushing.setName("bushing")
    bushing.set_rotational_damping(DAMPING[0])
    bushing.set_translational_damping(DAMPING[1])
    bushing.set_m_x_theta_x_function(opensim.LinearFunction(30.0, 1.0))
    bushing.set_m_z_theta_z_function(opensim.Sine(20.0, 2.0, 0.1))
    bushing.set_f_y_delta_y_function(opensim.PolynomialFunction(opensim.Vector([300.0, 20.0, 1.0])))
    between_tilted_frames(model, bushing)
    assert counted(model, tmp_path).is_nought()


def test_a_bushing_of_expressions(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    bushing = opensim.ExpressionBasedBushingForce()
    bushing.setName("bushing")
    bushing.set_rotational_damping(DAMPING[0])
    bushing.set_translational_damping(DAMPING[1])
    bushing.setMxExpression("30*theta_x + 4*theta_y^2")
    bushing.setMyExpression("-5*exp(-square(theta_z))")
    bushing.setMzExpression("theta_z*delta_x*100")
    bushing.setFxExpression("200*delta_x - 1")
    bushing.setFyExpression("min(delta_y, 0.1)*300")
    bushing.setFzExpression("k*delta_z^3; k=2*half; half=150")
    between_tilted_frames(model, bushing)
    assert counted(model, tmp_path).is_nought()


@pytest.mark.parametrize("slack_length", [0.4, 0.45, 0.6])
def test_a_ligament_of_blankevoort(slack_length: float, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    ligament = opensim.Blankevoort1991Ligament()
    ligament.setName("ligament")
    ligament.set_slack_length(slack_length)
    ligament.set_linear_stiffness(300.0)
    ligament.set_transition_strain(0.3)
    ligament.set_damping_coefficient(20.0)
    model.addForce(given(ligament))
    lay(model, ligament)
    assert counted(model, tmp_path).is_nought()


@pytest.mark.parametrize("is_clamped", [True, False])
def test_a_formula_along_a_path(is_clamped: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    force = opensim.ExpressionBasedPathForce("band", 0.5, "300*s*(1+0.2*ldot) + 2*cos(s)", is_clamped)
    model.addForce(given(force))
    lay(model, force)
    assert counted(model, tmp_path).is_nought()


@pytest.mark.parametrize("has_offset", [False, True])
def test_a_spring_between_points_pulls_and_pushes(has_offset: bool, tmp_path: Path) -> None:
    """Points count in the bodies, in OpenSim 4.6 also where the frames have an offset."""
    model = model_with(opensim.UniversalJoint)
    frames = [frame_of(model, "ground"), frame_of(model, "lower")]
    if has_offset:
        frames[1] = opensim.PhysicalOffsetFrame("tilted", frames[1], tilted())
        frame_of(model, "lower").addComponent(given(frames[1]))
        model.finalizeConnections()
    spring = opensim.PointToPointSpring(frames[0], vec3(0.2, 0.1, 0), frames[1], vec3(0, -0.1, 0.3), 200.0, 0.5)
    spring.setName("spring")
    model.addForce(given(spring))
    assert counted(model, tmp_path).is_nought()


def test_a_formula_between_points(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    force = opensim.ExpressionBasedPointToPointForce(
        "upper", vec3(0.2, 0.1, 0), "lower", vec3(0, -0.1, 0.3), "20/d^2 + 3*ddot - 5*log(d)"
    )
    force.setName("charge")
    model.addForce(given(force))
    assert counted(model, tmp_path).is_nought()


@pytest.mark.parametrize("coordinate", ["first_coord_0", "first_coord_1", "second_coord_0"])
def test_a_formula_of_a_coordinate(coordinate: str, tmp_path: Path) -> None:
    model = model_with(opensim.PlanarJoint)
    force = opensim.ExpressionBasedCoordinateForce(coordinate, "-2*q^3 - 0.5*qdot*abs(qdot) + sin(q)")
    force.setName("passive")
    model.addForce(given(force))
    assert difference(model, tmp_path).is_nought()


@pytest.mark.parametrize("is_force_global", [False, True])
@pytest.mark.parametrize("is_point_global", [False, True])
@pytest.mark.parametrize("has_offset", [False, True])
def test_a_constant_force(is_force_global: bool, is_point_global: bool, has_offset: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    frame = frame_of(model, "lower")
    if has_offset:
        frame = opensim.PhysicalOffsetFrame("tilted", frame, tilted())
        frame_of(model, "lower").addComponent(given(frame))
        model.finalizeConnections()
    force = opensim.PrescribedForce("weight", frame)
    force.set_forceIsGlobal(is_force_global)
    force.set_pointIsGlobal(is_point_global)
    force.setForceFunctions(*constants(3, -20, 5))
    force.setPointFunctions(*constants(0.1, 0.2, -0.1))
    force.setTorqueFunctions(*constants(1, 0, -2))
    model.addForce(given(force))
    assert counted(model, tmp_path).is_nought()


def test_a_constant_force_without_a_point_acts_at_the_origin(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    force = opensim.PrescribedForce("weight", frame_of(model, "lower"))
    force.set_pointIsGlobal(True)
    force.setForceFunctions(*constants(3, -20, 5))
    model.addForce(given(force))
    assert counted(model, tmp_path).is_nought()


def test_formulas_are_lepton_s(tmp_path: Path) -> None:
    """The accelerations of two bodies differ by the force of each formula."""
    model = model_with()
    for index, formula in enumerate(FORMULAS):
        force = opensim.ExpressionBasedCoordinateForce("second_coord_0", formula)
        force.setName(f"formula_{index}")
        model.addForce(given(force))
    ours = read_back(model, tmp_path)
    state = model.initSystem()
    coordinate = model.getCoordinateSet().get("second_coord_0")
    place = ours.coordinate_index("second_coord_0")
    q, u = (values[:, place] for values in random_states(ours))
    found = [Expression(formula, ("q", "qdot")).at(q, u) for formula in FORMULAS]
    theirs = []
    for value, speed in zip(q, u, strict=True):
        coordinate.setValue(state, float(value), False)
        coordinate.setSpeedValue(state, float(speed))
        model.realizeVelocity(state)
        forces = [model.getForceSet().get(f"formula_{index}") for index in range(len(FORMULAS))]
        theirs.append([force.getRecordValues(state).get(0) for force in forces])
    np.testing.assert_allclose(np.transpose(found), theirs, rtol=1e-12, atol=1e-13)
