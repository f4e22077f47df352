"""Springs, bushings, ligaments, contact and forces of a formula against OpenSim: they count in every acceleration."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.functions.coordinate_functions import Expression
from solver.model import Model
from solver.osim.model_reader import read_osim
from tests.solver.oracle.two_bodies import (
    Difference,
    along_path,
    assert_written,
    difference_to,
    frame_of,
    given,
    idle_states,
    made,
    model_with,
    opensim,
    printed,
    random_states,
    read_back,
    solvers_values,
    tilted_frame,
    vec3,
)

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


def between_tilted_frames(model: Any, bushing: Any) -> None:
    """Connect a bushing to frames that are tilted in both bodies."""
    for number, name in ((1, "upper"), (2, "lower")):
        bushing.updSocket(f"frame{number}").connect(tilted_frame(model, name))
    model.addForce(given(bushing))


def along(kind: str, name: str, *arguments: Any, **settings: Any) -> Callable[[Any], Any]:
    """Adds a force along a path."""
    return lambda model: along_path(model, made(kind, name, *arguments, **settings))


def at_points(kind: str, *arguments: Any) -> Callable[[Any], Any]:
    """Adds a force between two points of bodies."""
    return lambda model: model.addForce(given(made(kind, "spring", *arguments)))


def bushing(kind: str, **settings: Any) -> Callable[[Any], Any]:
    """Adds a bushing between frames that are tilted in both bodies."""
    damping = {"set_rotational_damping": vec3(2, 3, 4), "set_translational_damping": vec3(0.2, 0.3, 0.1)}
    return lambda model: between_tilted_frames(model, made(kind, "bushing", **damping, **settings))


def spring_between_points(has_offset: bool) -> Callable[[Any], Any]:
    """Points count in the bodies, in OpenSim 4.6 also where the frames have an offset."""

    def add(model: Any) -> None:
        frame = tilted_frame(model, "lower") if has_offset else frame_of(model, "lower")
        ends = frame_of(model, "ground"), vec3(0.2, 0.1, 0), frame, vec3(0, -0.1, 0.3)
        model.addForce(given(made("PointToPointSpring", "spring", *ends, 200.0, 0.5)))

    return add


def constant_force(has_offset: bool, **settings: Any) -> Callable[[Any], Any]:
    """A force of constant components; without a point it acts at the origin."""
    functions = {
        name: tuple(opensim.Constant(float(value)) for value in values) if isinstance(values, tuple) else values
        for name, values in {"setForceFunctions": (3, -20, 5), **settings}.items()
    }

    def add(model: Any) -> None:
        frame = tilted_frame(model, "lower") if has_offset else frame_of(model, "lower")
        model.addForce(given(made("PrescribedForce", "weight", "weight", frame, **functions)))

    return add


def smooth_contact(dissipation: float) -> Callable[[Any], Any]:
    figures = {"stiffness": 1e6, "dissipation": dissipation, "static_friction": 0.9, "dynamic_friction": 0.6}
    figures |= {"viscous_friction": 0.2, "transition_velocity": 0.2, "constant_contact_force": 2e-5}
    figures |= {"hertz_smoothing": 200.0, "hunt_crossley_smoothing": 40.0}

    def add(model: Any) -> None:
        floor, heel = floor_of(model), heel_of(model)
        for shape in (floor, heel):
            model.addContactGeometry(given(shape))
        settings = {f"set_{name}": figure for name, figure in figures.items()}
        model.addForce(given(made("SmoothSphereHalfSpaceForce", "smooth", "smooth", heel, floor, **settings)))

    return add


def hard_contact(model: Any) -> None:
    for shape in (floor_of(model), heel_of(model)):
        model.addContactGeometry(given(shape))
    force = made("HuntCrossleyForce", "hard", setStiffness=1e6, setDissipation=0.5, setStaticFriction=0.8)
    for name in ("floor", "heel"):
        force.addGeometry(name)
    model.addForce(given(force))


def floor_of(model: Any) -> Any:
    return opensim.ContactHalfSpace(vec3(0.1, -0.3, 0), vec3(0.1, 0.2, -1.4), model.getGround(), "floor")


def heel_of(model: Any) -> Any:
    return opensim.ContactSphere(0.1, vec3(0.02, -0.15, 0.01), frame_of(model, "lower"), "heel")


def curve_of_a_ligament() -> Any:
    curve = opensim.SimmSpline()
    for x, y in ((0.9, 0.0), (1.0, 0.0), (1.1, 0.2), (1.3, 1.5), (1.6, 4.0)):
        curve.addPoint(x, y)
    return curve


LIGAMENT = {"setRestingLength": 0.5, "setMaxIsometricForce": 120.0}
BLANKEVOORT = {"set_linear_stiffness": 300.0, "set_transition_strain": 0.3, "set_damping_coefficient": 20.0}
ENDS = "upper", vec3(0.2, 0.1, 0), "lower", vec3(0, -0.1, 0.3)
FORCES: dict[str, Callable[[Any], Any]] = {
    "bushing": bushing(
        "BushingForce", set_translational_stiffness=vec3(300, 500, 700), set_rotational_stiffness=vec3(3, 5, 7)
    ),
    "bushing of functions": bushing(
        "FunctionBasedBushingForce",
        set_m_x_theta_x_function=opensim.LinearFunction(30.0, 1.0),
        set_m_z_theta_z_function=opensim.Sine(20.0, 2.0, 0.1),
        set_f_y_delta_y_function=opensim.PolynomialFunction(opensim.Vector([300.0, 20.0, 1.0])),
    ),
    "bushing of expressions": bushing(
        "ExpressionBasedBushingForce",
        setMxExpression="30*theta_x + 4*theta_y^2",
        setMyExpression="-5*exp(-square(theta_z))",
        setMzExpression="theta_z*delta_x*100",
        setFxExpression="200*delta_x - 1",
        setFyExpression="min(delta_y, 0.1)*300",
        setFzExpression="k*delta_z^3; k=2*half; half=150",
    ),
    "spring along a path": along("PathSpring", "spring", "spring", 0.5, 800.0, 0.3),
    "ligament": along("Ligament", "ligament", **LIGAMENT),
    "ligament with a curve of its own": along(
        "Ligament", "ligament", **LIGAMENT, setForceLengthCurve=curve_of_a_ligament()
    ),
    **{
        f"Blankevoort's ligament of {slack} m": along(
            "Blankevoort1991Ligament", "ligament", **BLANKEVOORT, set_slack_length=slack
        )
        for slack in (0.4, 0.45, 0.6)
    },
    **{
        f"formula along a path, clamped: {is_clamped}": along(
            "ExpressionBasedPathForce", "band", "band", 0.5, "300*s*(1+0.2*ldot) + 2*cos(s)", is_clamped
        )
        for is_clamped in (True, False)
    },
    "spring between points": spring_between_points(False),
    "spring between points, one in an offset frame": spring_between_points(True),
    "formula between points": at_points("ExpressionBasedPointToPointForce", *ENDS, "20/d^2 + 3*ddot - 5*log(d)"),
    **{
        f"constant force, {axes} axes, {point} point, {frame}": constant_force(
            frame == "offset frame",
            setPointFunctions=(0.1, 0.2, -0.1),
            setTorqueFunctions=(1, 0, -2),
            set_forceIsGlobal=axes == "global",
            set_pointIsGlobal=point == "global",
        )
        for axes in ("global", "local")
        for point in ("global", "local")
        for frame in ("offset frame", "body")
    },
    "constant force without a point": constant_force(False, set_pointIsGlobal=True),
    "smooth contact": smooth_contact(0.0),
    "smooth contact with dissipation": smooth_contact(1.2),
    "hard contact": hard_contact,
}
SPRING = {"setStiffness": 7.0, "setRestLength": 0.3, "setViscosity": 0.4}
COORDINATE_FORCES: dict[str, Callable[[str], Any]] = {
    "spring": lambda coordinate: made("SpringGeneralizedForce", "force", coordinate, **SPRING),
    "limit of an angle": lambda coordinate: made(
        "CoordinateLimitForce", "force", coordinate, 20.0, 0.2, -15.0, 0.3, 0.01, 30.0
    ),
    "limit of a distance": lambda coordinate: made(
        "CoordinateLimitForce", "force", coordinate, 0.3, 0.2, -0.2, 0.3, 0.01, 0.5
    ),
    "formula": lambda coordinate: made(
        "ExpressionBasedCoordinateForce", "force", coordinate, "-2*q^3 - 0.5*qdot*abs(qdot) + sin(q)"
    ),
}


@pytest.mark.parametrize("kind", FORCES)
def test_a_force_accelerates_as_in_opensim_and_comes_back_from_the_file_that_is_written(
    kind: str, tmp_path: Path
) -> None:
    model = model_with(opensim.UniversalJoint)
    FORCES[kind](model)
    ours = read_back(model, tmp_path)
    assert counted(model, ours).is_nought()
    assert_written(ours, model, tmp_path)


@pytest.mark.parametrize("kind", COORDINATE_FORCES)
@pytest.mark.parametrize(
    ("joint", "coordinate"),
    [("PlanarJoint", f"first_coord_{k}") for k in (0, 1)]
    + [("FreeJoint", "first_coord_2"), ("PlanarJoint", "second_coord_0")],
)
def test_a_force_of_a_coordinate_accelerates_as_in_opensim_and_comes_back(
    joint: str, coordinate: str, kind: str, tmp_path: Path
) -> None:
    model = model_with(getattr(opensim, joint))
    model.addForce(given(COORDINATE_FORCES[kind](coordinate)))
    ours = read_back(model, tmp_path)
    assert len(ours.coordinate_forces) == 1
    assert difference_to(model, ours).is_nought()
    assert_written(ours, model, tmp_path)


def test_the_curve_of_a_ligament_may_be_within_its_property_as_in_earlier_files(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    along_path(model, made("Ligament", "ligament", **LIGAMENT, setForceLengthCurve=opensim.SimmSpline()))
    file = printed(model, tmp_path / "ligament.osim")
    curve = "<force_length_curve><SimmSpline><x>1 1.1 1.2 1.5</x><y>0 0.3 0.5 4</y></SimmSpline></force_length_curve>"
    own = re.compile(r'<SimmSpline name="force_length_curve">.*?</SimmSpline>', re.DOTALL)
    text, count = own.subn(curve, file.read_text())
    assert count == 1
    file.write_text(text)
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()


@pytest.mark.parametrize("kinds", ["floor and two spheres", "two spheres", "one material"])
def test_contact_of_spheres_and_a_half_space(kinds: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    floor, heel = floor_of(model), heel_of(model)
    toe = opensim.ContactSphere(0.36, vec3(-0.1, -0.05, 0.05), frame_of(model, "upper"), "toe")
    shapes = {"floor and two spheres": [floor, heel, toe], "two spheres": [heel, toe], "one material": [floor, heel]}
    for shape in shapes[kinds]:
        model.addContactGeometry(given(shape))
    model.addForce(given(made("HuntCrossleyForce", "contact", setTransitionVelocity=0.2, addGeometry="heel")))
    materials = [(1e6, 0.5, 0.9, 0.6, 0.2), (3e5, 1.0, 0.7, 0.3, 0.0), (5e5, 0.0, 0.0, 0.0, 0.0)]
    used = materials[:1] * 3 if kinds == "one material" else materials
    groups = [group(shape.getName(), *figures) for shape, figures in zip(shapes[kinds], used, strict=False)]
    file = printed(model, tmp_path / "contact.osim")
    one = re.compile(r"<HuntCrossleyForce::ContactParameters>.*</HuntCrossleyForce::ContactParameters>", re.DOTALL)
    file.write_text(one.sub("".join(groups), file.read_text()))
    contact = opensim.Model(str(file))
    assert counted(contact, read_back(contact, tmp_path)).is_nought()


def group(geometry: str, *figures: float) -> str:
    """The Python interface of OpenSim has one group of contact parameters only."""
    names = ("stiffness", "dissipation", "static_friction", "dynamic_friction", "viscous_friction")
    values = "".join(f"<{name}>{figure}</{name}>" for name, figure in zip(names, figures, strict=True))
    tag = "HuntCrossleyForce::ContactParameters"
    return f"<{tag}><geometry>{geometry}</geometry>{values}</{tag}>"


def test_what_is_switched_off_does_not_act_and_is_named(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    along_path(model, made("PathSpring", "spring", "spring", 0.1, 800.0, 0.3, set_appliesForce=False))
    ends = frame_of(model, "ground"), vec3(0, 0, 0), frame_of(model, "lower"), vec3(0, 0, 0)
    model.addConstraint(given(made("PointConstraint", "held", *ends, set_isEnforced=False)))
    ours = read_back(model, tmp_path)
    assert ours.left_out == ("PathSpring spring", "PointConstraint held")
    assert difference_to(model, ours).is_nought()


def test_a_body_without_mass_has_no_inertia(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    frame_of(model, "upper").setMass(0.0)
    ours = read_back(model, tmp_path)
    assert not ours.bodies[1].inertia.any()
    assert difference_to(model, ours).is_nought()


def counted(model: Any, ours: Model) -> Difference:
    """The difference, of a force that changes accelerations in several of the postures."""
    states = random_states(ours)
    without = replace(ours, forces=())
    change = solvers_values(ours, *states)["acceleration"] - solvers_values(without, *states)["acceleration"]
    assert (np.abs(change).max(axis=1) > 1.0).sum() > 3
    return difference_to(model, ours)


def test_formulas_are_lepton_s(tmp_path: Path) -> None:
    """The accelerations of two bodies differ by the force of each formula."""
    model = model_with()
    for index, formula in enumerate(FORMULAS):
        force = made("ExpressionBasedCoordinateForce", f"formula_{index}", "second_coord_0", formula)
        model.addForce(given(force))
    ours = read_back(model, tmp_path)
    q, u = (values[:, [ours.coordinate_index("second_coord_0")]] for values in random_states(ours))
    found = [Expression(formula, ("q", "qdot")).at(q[:, 0], u[:, 0]) for formula in FORMULAS]
    theirs = []
    for state in idle_states(model, ["second_coord_0"], q, u):
        model.realizeVelocity(state)
        forces = [model.getForceSet().get(f"formula_{index}") for index in range(len(FORMULAS))]
        theirs.append([force.getRecordValues(state).get(0) for force in forces])
    np.testing.assert_allclose(np.transpose(found), theirs, rtol=1e-12, atol=1e-13)
