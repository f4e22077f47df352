"""Springs, bushings, ligaments and contact between bodies, against OpenSim: they count in every acceleration."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.osim.model_reader import read_osim
from tests.solver.oracle.test_paths import path_of, tilted
from tests.solver.oracle.two_bodies import (
    Difference,
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

pytestmark = pytest.mark.oracle


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
