"""Two bodies in OpenSim, one hinged on the other: what each component that the solver supports is tested on.

A test builds the model through OpenSim's API; it is printed to a file, read by the solver, and both are asked for the
same things at the same random postures.
"""

import xml.etree.ElementTree as Xml
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.model import Array, Model
from solver.multibody.constraints import constraint_gaps, constraint_rows
from solver.multibody.dynamics import equations_of_motion
from solver.multibody.loads import load_wrenches
from solver.multibody.postures import jacobians, postures, rates_of_coordinates
from solver.muscle import evaluate_paths, muscle_forces
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.redundancy.mechanics import ResponseMaps, response_maps
from tests.solver.osim.test_model_writer import assert_same

opensim = pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")

STATES = 25
opensim.Logger.setLevelString("error")


def vec3(x: float, y: float, z: float) -> Any:
    return opensim.Vec3(float(x), float(y), float(z))


def given(component: Any) -> Any:
    """Hands the component's memory to OpenSim, which deletes what is added to it."""
    component.thisown = False
    return component


def made(kind: str, name: str, *arguments: Any, **settings: Any) -> Any:
    """An object of a class of OpenSim; settings by the names of its setters, several arguments of one in a tuple."""
    component = getattr(opensim, kind)(*arguments)
    component.setName(name)
    for setter, value in settings.items():
        getattr(component, setter)(*(value if isinstance(value, tuple) else (value,)))
    return component


def tilted_frame(model: Any, name: str) -> Any:
    """A frame with an offset and a rotation in a body."""
    rotation = opensim.Rotation()
    rotation.setRotationToBodyFixedXYZ(vec3(0.2, -0.3, 0.4))
    place = opensim.Transform(rotation, vec3(0.05, -0.1, 0.02))
    frame = opensim.PhysicalOffsetFrame(f"{name}_tilted", frame_of(model, name), place)
    frame_of(model, name).addComponent(given(frame))
    model.finalizeConnections()
    return frame


def body(name: str) -> Any:
    return opensim.Body(name, 1.3, vec3(0.02, -0.11, 0.03), opensim.Inertia(0.02, 0.015, 0.018, 0.001, -0.002, 0.0015))


def model_with(make_joint: Callable[..., Any] | None = None) -> Any:
    """Ground, body `upper` on the joint under test (a pin if none is given), body `lower` on a pin, and a muscle.

    make_joint(name, parent, place, angles, child, place, angles) as the constructors of OpenSim's joints.
    """
    model = opensim.Model()
    model.setName("two_bodies")
    model.setGravity(vec3(0.5, -9.7, 0.3))
    upper, lower = body("upper"), body("lower")
    model.addBody(given(upper))
    model.addBody(given(lower))
    tilted = (vec3(0.1, 0.2, -0.1), vec3(0.3, -0.4, 0.5)), (vec3(0.02, 0.05, 0.01), vec3(-0.2, 0.1, 0.6))
    hinged = (vec3(0.01, -0.25, 0.02), vec3(0.2, 0.3, -0.1)), (vec3(0.0, 0.1, 0.0), vec3(0.1, 0.0, 0.2))
    made = (make_joint or opensim.PinJoint)("first", model.getGround(), *tilted[0], upper, *tilted[1])
    model.addJoint(given(made))
    model.addJoint(given(opensim.PinJoint("second", upper, *hinged[0], lower, *hinged[1])))
    model.finalizeConnections()
    add_muscle(
        model, "pull", [("ground", (0.05, 0.1, 0.02)), ("upper", (0.03, -0.1, 0.04)), ("lower", (0.02, -0.2, 0))]
    )
    return model


def frame_of(model: Any, name: str) -> Any:
    return model.getGround() if name == "ground" else model.getBodySet().get(name)


def add_muscle(model: Any, name: str, points: list[tuple[str, tuple[float, float, float]]]) -> Any:
    """A muscle over fixed points; its minimum of the active force is zero, all else as OpenSim has it."""
    muscle = opensim.Millard2012EquilibriumMuscle(name, 200.0, 0.2, 0.15, 0.1)
    muscle.set_ignore_tendon_compliance(True)
    muscle.set_ignore_activation_dynamics(True)
    muscle.upd_ActiveForceLengthCurve().setMinValue(0.0)
    model.addForce(given(muscle))
    for index, (body_name, place) in enumerate(points):
        path_of(muscle).appendNewPathPoint(f"{name}-{index}", frame_of(model, body_name), vec3(*place))
    return muscle


def span(model: Any, muscle: Any) -> Any:
    """The muscle, added from the ground to the second body."""
    model.addForce(given(muscle))
    path_of(muscle).appendNewPathPoint("start", model.getGround(), vec3(0.05, 0.1, 0.02))
    path_of(muscle).appendNewPathPoint("end", frame_of(model, "lower"), vec3(0.02, -0.2, 0.0))
    return muscle


def path_of(force: Any) -> Any:
    return opensim.GeometryPath.safeDownCast(force.updPath())


def along_path(model: Any, force: Any) -> Any:
    """The force, added along a path from the ground to the second body."""
    model.addForce(given(force))
    path_of(force).appendNewPathPoint("start", frame_of(model, "ground"), vec3(0.3, 0.2, -0.1))
    path_of(force).appendNewPathPoint("end", frame_of(model, "lower"), vec3(0.02, -0.2, 0.1))
    return force


def read_back(model: Any, folder: Path) -> Model:
    """The model through a file, as a user's would come."""
    return read_osim(printed(model, folder / "two_bodies.osim"))


def printed(model: Any, file: Path, *exchanged: tuple[str, str]) -> Path:
    """OpenSim's file of the model, with texts exchanged that it must contain."""
    model.finalizeConnections()
    model.printToXML(str(file))
    text = file.read_text(encoding="utf-8")
    for old, new in exchanged:
        assert old in text
        text = text.replace(old, new)
    file.write_text(text, encoding="utf-8")
    return file


def written(model: Model, file: Path) -> Path:
    """The solver's file of the model."""
    Xml.ElementTree(osim_document(model)).write(file, encoding="utf-8")
    return file


@dataclass(frozen=True)
class Difference:
    """Greatest |Δ| of each quantity over all states; of velocities, masses, accelerations and constraints over the
    greatest |reference|, if that is above 1."""

    pose: float
    velocity: float
    rates: float
    mass_matrix: float
    acceleration: float
    constraint: float
    gap: float
    length: float
    speed: float
    force_per_tension: float

    def is_nought(self) -> bool:
        return (
            max(self.pose, self.velocity, self.rates, self.gap) < 1e-13
            and max(self.mass_matrix, self.constraint, self.length) < 1e-12
            and max(self.speed, self.force_per_tension) < 1e-11
            and self.acceleration < 1e-10
        )


def force_parts(model: Model) -> tuple[Any, ...]:
    return model.forces, model.actuators, model.coordinate_forces


def assert_written(ours: Model, osim: Any, folder: Path) -> None:
    """OpenSim opens the file that the solver writes; its accelerations are those of OpenSim's own model."""
    file = written(ours, folder / "written.osim")
    again = read_osim(file)
    assert_same(force_parts(ours), force_parts(again))
    assert difference_to(opensim.Model(str(file)), again).is_nought()
    assert difference_to(osim, again).is_nought()


def difference(model: Any, folder: Path, spread: float = 0.6) -> Difference:
    """Of the solver from OpenSim, at random coordinates (normal, `spread`) and speeds (normal, 1)."""
    return difference_to(model, read_back(model, folder), spread)


def difference_to(model: Any, ours: Model, spread: float = 0.6) -> Difference:
    """As difference, of a model that has been read."""
    theirs = _opensims(model, ours, *random_states(ours, spread))
    found = solvers_values(ours, theirs["q"], theirs["u"])
    scales = {
        name: max(1.0, np.abs(theirs[name]).max(initial=0.0))
        for name in ("velocity", "mass_matrix", "acceleration", "constraint")
    }
    return Difference(
        **{name: float(np.abs(found[name] - theirs[name]).max(initial=0.0)) / scales.get(name, 1.0) for name in found}
    )


def random_states(model: Model, spread: float = 0.6) -> tuple[Array, Array]:
    random = np.random.default_rng(7)
    q = spread * random.normal(size=(STATES, len(model.coordinates)))
    return q, random.normal(size=q.shape)


def solvers_values(model: Model, q: Array, u: Array) -> dict[str, Array]:
    state = postures(model, q, u)
    equations = equations_of_motion(model, state, reaction_joint="second")
    paths = evaluate_paths(model, state)
    force = np.einsum("fmbi,fbij->fmj", paths.wrench_per_tension, jacobians(model, state))
    to_rates, _ = rates_of_coordinates(model, state)
    velocity = np.concatenate([state.angular_velocity, state.origin_velocity], axis=-1)[:, 1:]
    pose = np.concatenate([state.rotation_to_ground, state.origin_in_ground[..., None]], axis=-1)[:, 1:]
    return {
        "pose": pose,
        "velocity": velocity,
        "rates": np.einsum("fij,fj->fi", to_rates, u),
        "mass_matrix": equations.mass_matrix,
        "acceleration": equations.acceleration_unloaded,
        "constraint": constraint_rows(model, state)[0],
        "gap": constraint_gaps(model, state),
        "length": paths.lengths,
        "speed": paths.speeds,
        "force_per_tension": force + paths.mobility_per_tension,
    }


def idle_states(
    osim: Any, names: Sequence[str], q: Array, u: Array, time: Array | None = None, tension: float = 0.0
) -> Iterator[Any]:
    """OpenSim's state at these coordinates, speeds and times, with the same tension of all muscles."""
    state = osim.initSystem()
    for muscle in osim.getMuscles():
        muscle.overrideActuation(state, True)
        muscle.setOverrideActuation(state, tension)
    coordinates = [osim.getCoordinateSet().get(name) for name in names]
    for moment, values, speeds in zip(np.zeros(len(q)) if time is None else time, q, u, strict=True):
        state.setTime(float(moment))
        set_state(state, coordinates, values, speeds)
        yield state


def response(osim: Any, state: Any, names: Sequence[str], joint: str) -> tuple[list[float], list[float]]:
    """Accelerations of these coordinates, and the joint's reaction on its parent, in ground."""
    osim.realizeAcceleration(state)
    wrench = osim.getJointSet().get(joint).calcReactionOnParentExpressedInGround(state)
    accelerations = [osim.getCoordinateSet().get(name).getAccelerationValue(state) for name in names]
    return accelerations, [wrench.get(part).get(axis) for part in range(2) for axis in range(3)]


def idle_maps(model: Model, q: Array, u: Array, joint: str = "second", loads: Any = ()) -> ResponseMaps:
    """The solver's maps without muscle forces."""
    state = postures(model, q, u)
    paths, equations = evaluate_paths(model, state), equations_of_motion(model, state, reaction_joint=joint)
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    still = replace(forces, passive=np.zeros_like(forces.passive))
    return response_maps(model, state, equations, paths, still, load_wrenches(loads, state) if loads else None)


def _opensims(osim: Any, model: Model, q: Array, u: Array) -> dict[str, Array]:
    rows = []
    for state in idle_states(osim, model.coordinate_names, q, u):
        osim.realizeAcceleration(state)
        rows.append(_at_state(osim, state, model))
    return {name: np.array([row[name] for row in rows]) for name in rows[0]}


def set_state(state: Any, coordinates: list[Any], values: Array, speeds: Array) -> None:
    for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
        if not coordinate.getLocked(state):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))


def _at_state(osim: Any, state: Any, model: Model) -> dict[str, Any]:
    coordinates = [osim.getCoordinateSet().get(name) for name in model.coordinate_names]
    muscles = [osim.getMuscles().get(name) for name in model.muscle_names]
    matter = osim.getMatterSubsystem()
    mass, jacobian = opensim.Matrix(), opensim.Matrix()
    matter.calcM(state, mass)
    matter.calcG(state, jacobian)
    by_name = {each.getName(): each for each in osim.getBodyList()}  # the BodySet lacks those that are components
    bodies = [by_name[each.name] for each in model.bodies[1:]]
    transforms = [each.getTransformInGround(state) for each in bodies]
    velocities = [each.getVelocityInGround(state) for each in bodies]
    return {
        "q": [c.getValue(state) for c in coordinates],
        "u": [c.getSpeedValue(state) for c in coordinates],
        "pose": [[[*(t.R().get(i, j) for j in range(3)), t.p().get(i)] for i in range(3)] for t in transforms],
        "velocity": [[v.get(k).get(i) for k in range(2) for i in range(3)] for v in velocities],
        "rates": [c.getQDotValue(state) for c in coordinates],
        "mass_matrix": mass.to_numpy(),
        "acceleration": [c.getAccelerationValue(state) for c in coordinates],
        "constraint": jacobian.to_numpy(),
        "gap": state.getQErr().to_numpy(),
        "length": [m.getLength(state) for m in muscles],
        "speed": [m.getLengtheningSpeed(state) for m in muscles],
        "force_per_tension": [force_per_tension(osim, state, m) for m in muscles],
    }


def force_per_tension(osim: Any, state: Any, muscle: Any) -> list[float]:
    """Generalised forces of a tension of 1 N, without constraints."""
    none = opensim.SpatialVec(opensim.Vec3(0), opensim.Vec3(0))
    bodies = 1 + max(b.getMobilizedBodyIndex() for b in osim.getBodyList())
    wrenches, mobility = opensim.VectorOfSpatialVec(bodies, none), opensim.Vector(state.getNU(), 0.0)
    path_of(muscle).addInEquivalentForces(state, 1.0, wrenches, mobility)
    force = opensim.Vector()
    osim.getMatterSubsystem().multiplyBySystemJacobianTranspose(state, wrenches, force)
    total: list[float] = (force.to_numpy() + mobility.to_numpy()).tolist()
    return total
