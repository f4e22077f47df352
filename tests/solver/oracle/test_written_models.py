"""Forces, muscles and constraints that the solver writes: OpenSim opens the file, with the same accelerations."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.constraint import (
    ConstantDistanceConstraint,
    CoordinateCoupler,
    PointOnLineConstraint,
)
from solver.functions.coordinate_functions import polynomial
from solver.functions.muscle_curves import DeGrooteFreglyCurves, SchutteCurves, ThelenCurves
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from tests.solver.oracle.test_actuators import ADDED
from tests.solver.oracle.test_force_elements import between_tilted_frames, constants, lay
from tests.solver.oracle.test_scaling import ALONG_PATHS
from tests.solver.oracle.two_bodies import difference_to, frame_of, given, model_with, opensim, read_back, vec3
from tests.solver.osim.test_model_writer import assert_same


def springs_of_coordinates(model: Any) -> None:
    spring = opensim.SpringGeneralizedForce("first_coord_0")
    spring.setStiffness(7.0)
    spring.setRestLength(0.3)
    spring.setViscosity(0.4)
    formula = opensim.ExpressionBasedCoordinateForce("first_coord_1", "-2*q^3 - 0.5*qdot")
    for force in (spring, formula, opensim.CoordinateLimitForce("second_coord_0", 20.0, 0.2, -15.0, 0.3, 0.01, 30.0)):
        model.addForce(given(force))


def along_paths(model: Any) -> None:
    for kind, make in ALONG_PATHS.items():
        force = make()
        force.setName(kind)
        model.addForce(given(force))
        lay(model, force)


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
    floor = opensim.ContactHalfSpace(vec3(0.1, -0.3, 0), vec3(0.1, 0.2, -1.4), model.getGround(), "floor")
    heel = opensim.ContactSphere(0.1, vec3(0.02, -0.15, 0.01), frame_of(model, "lower"), "heel")
    for shape in (floor, heel):
        model.addContactGeometry(given(shape))
    smooth = opensim.SmoothSphereHalfSpaceForce("smooth", heel, floor)
    smooth.set_dissipation(1.2)
    model.addForce(given(smooth))
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


PLACES = (0, 2, np.array([0.01, 0.0, 0.02]), np.array([0.0, 0.1, 0.0]))
CONSTRAINTS = {
    "distance": ConstantDistanceConstraint("held", *PLACES, 0.4),
    "line": PointOnLineConstraint("held", *PLACES, np.array([0.6, 0.0, 0.8])),
    "coupler": CoordinateCoupler("held", 1, (0,), (polynomial([0.1, 2.0, 0.3]),)),
    "coupler of two": CoordinateCoupler("held", 1, (0, 3), (polynomial([0.1, 2.0]), polynomial([0.0, 3.0]))),
}


@pytest.mark.parametrize("kind", CONSTRAINTS)
def test_opensim_opens_the_constraints_that_are_written(kind: str, tmp_path: Path) -> None:
    read = read_back(model_with(opensim.PlanarJoint), tmp_path)
    assert_opensim_opens(replace(read, constraints=(CONSTRAINTS[kind],)), tmp_path)


def assert_opensim_opens(model: Any, folder: Path) -> None:
    file = folder / "written.osim"
    Xml.ElementTree(osim_document(model)).write(file, encoding="utf-8")
    assert difference_to(opensim.Model(str(file)), read_osim(file)).is_nought()
