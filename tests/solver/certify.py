"""Writes certified.json: what OpenSim computes for the bundled model, which is built here through OpenSim's own API.

Run from the repository with the extra `oracle` installed (package opensim): python -m tests.solver.certify
Nothing but the bundled table goes in, so the figures carry its attribution; muscles have rigid tendons and no
activation dynamics, and coordinates are set as they are, without assembling the constraint.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import opensim

from solver.bundled import bundled_model
from solver.model import Array, AxisMotion, Model, MovingPathPoint, Muscle, PathPoint, Placement, WrapSurface

CERTIFIED = Path(__file__).with_name("certified.json")
STATES = 20


def main() -> None:
    model = bundled_model()
    oracle = Oracle(model)
    states = [oracle.evaluate(q, u) for q, u in zip(*chosen_states(model), strict=True)]
    certified = {
        "made_by": "tests/solver/certify.py",
        "opensim": opensim.GetVersionAndDate(),
        "model": "solver/thoracoscapular.toml, built through the opensim package's API",
        "attribution": "model: Seth, Dong, Matias, Delp 2019, Front. Neurorobot. 13:90, as modified by Belli et al. "
        "2023, PLoS ONE 18(11):e0295003; CC BY 4.0; these figures are derived from a modification of it",
        "units": "SI; everything in ground; rows and columns in the model's order, bodies without the ground",
        "states": states,
    }
    CERTIFIED.write_text(json.dumps(certified, separators=(",", ":")).replace('},{"q"', '},\n{"q"') + "\n")
    print(f"{CERTIFIED.name}: {len(states)} states, {CERTIFIED.stat().st_size} bytes")


def chosen_states(model: Model) -> tuple[Array, Array]:
    """q and u (states, coordinates): a raised arm with the scapula following, the last third scattered widely."""
    random = np.random.default_rng(20190)
    q = np.tile(model.default_coordinates, (STATES, 1))
    raised = np.linspace(0.3, 2.4, STATES)
    follows = {"shoulder_elv": 1.0, "scapula_upward_rot": 0.45, "clav_elev": 0.15, "scapula_abduction": -0.1}
    for name, share in follows.items():
        q[:, model.coordinate_index(name)] += share * (raised - raised[0])
    spread = np.where(np.arange(STATES) < 2 * STATES // 3, 0.05, 0.3)[:, None]
    q += spread * random.normal(size=q.shape)
    q[:, model.coordinate_index("elbow_flexion")] = random.uniform(0.0, 2.0, STATES)
    return q, random.normal(size=q.shape)


class Oracle:
    """The model in OpenSim, and everything the solver is compared with, at one state after the other.

    OpenSim's model is built of ours, or read from a file.
    """

    def __init__(self, model: Model, file: Path | None = None) -> None:
        opensim.Logger.setLevelString("error")
        self.model, self.osim = model, build(model) if file is None else _read(file)
        self.state = self.osim.initSystem()
        self.matter = self.osim.getMatterSubsystem()
        indices = [self.osim.getBodySet().get(body.name).getMobilizedBodyIndex() for body in model.bodies[1:]]
        self.mobilized_bodies = 1 + max(indices)
        self.coordinates = [self.osim.getCoordinateSet().get(name) for name in model.coordinate_names]
        self.muscles = [
            opensim.Millard2012EquilibriumMuscle.safeDownCast(self.osim.getMuscles().get(name))
            for name in model.muscle_names
        ]
        self.actuators = [
            opensim.ScalarActuator.safeDownCast(self.osim.getForceSet().get(a.name)) for a in model.actuators
        ]
        for muscle in self.muscles:
            muscle.overrideActuation(self.state, True)

    def evaluate_all(self, q: Array, u: Array) -> dict[str, Array]:
        """Each quantity (states, …) at q and u (states, coordinates)."""
        states = [self.evaluate(*state) for state in zip(q, u, strict=True)]
        return {name: np.array([state[name] for state in states]) for name in states[0]}

    def evaluate_at_rest(self, q: Array, u: Array, passive: Array) -> dict[str, Array]:
        """A few quantities of many states: paths, and what passive (states, muscles) alone does."""
        idle = np.zeros(len(self.muscles) + len(self.actuators))
        rows = []
        for values, speeds, tensions in zip(q, u, passive, strict=True):
            self.pose(values, speeds)
            lengths = [m.getLength(self.state) for m in self.muscles]
            rates = [m.getLengtheningSpeed(self.state) for m in self.muscles]
            rows.append((lengths, rates, *self.respond(idle, tensions, tensions)))
        names = ("length", "speed", "acceleration_at_rest", "reaction_at_rest")
        return {name: np.array(column) for name, column in zip(names, zip(*rows, strict=True), strict=True)}

    def pose(self, q: Array, u: Array) -> None:
        for coordinate, value, speed in zip(self.coordinates, q, u, strict=True):
            coordinate.setValue(self.state, float(value), False)
            coordinate.setSpeedValue(self.state, float(speed))
        self.osim.realizeVelocity(self.state)

    def evaluate(self, q: Array, u: Array) -> dict[str, Any]:
        self.pose(q, u)
        row = {"q": q.tolist(), "u": u.tolist(), **self.postures(), **self.equations(), **self.paths()}
        return row | self.maps(np.array(row["active_force"]), np.array(row["passive_force"]))

    def postures(self) -> dict[str, Any]:
        bodies = [self.osim.getBodySet().get(body.name) for body in self.model.bodies[1:]]
        transforms = [body.getTransformInGround(self.state) for body in bodies]
        velocities = [body.getVelocityInGround(self.state) for body in bodies]
        return {
            "rotation": [[[t.R().get(i, j) for j in range(3)] for i in range(3)] for t in transforms],
            "origin": [_values(t.p()) for t in transforms],
            "velocity": [_values(v.get(0)) + _values(v.get(1)) for v in velocities],
        }

    def equations(self) -> dict[str, Any]:
        mass, jacobian, bias = opensim.Matrix(), opensim.Matrix(), opensim.Vector()
        self.matter.calcM(self.state, mass)
        self.matter.calcG(self.state, jacobian)
        self.matter.calcBiasForAccelerationConstraints(self.state, bias)
        return {
            "mass_matrix": mass.to_numpy().tolist(),
            "constraint_jacobian": jacobian.to_numpy().tolist(),
            "constraint_bias": bias.to_numpy().tolist(),
        }

    def paths(self) -> dict[str, Any]:
        state, muscles = self.state, self.muscles
        factors = [
            (
                m.getActiveForceLengthMultiplier(state),
                m.getForceVelocityMultiplier(state),
                m.getPassiveForceMultiplier(state),
                m.getCosPennationAngle(state),
            )
            for m in muscles
        ]
        length, velocity, passive, cosine = np.array(factors).T
        strength = np.array([muscle.max_isometric_force for muscle in self.model.muscles])
        return {
            "length": [m.getLength(state) for m in muscles],
            "speed": [m.getLengtheningSpeed(state) for m in muscles],
            "force_per_tension": [self.force_per_tension(m) for m in muscles],
            "factors": factors,
            "active_force": (strength * length * velocity * cosine).tolist(),
            "passive_force": (strength * passive * cosine).tolist(),
        }

    def force_per_tension(self, muscle: Any) -> list[float]:
        """Generalised forces of a tension of 1 N, without the constraint."""
        wrenches = opensim.VectorOfSpatialVec(
            self.mobilized_bodies, opensim.SpatialVec(opensim.Vec3(0), opensim.Vec3(0))
        )
        mobility = opensim.Vector(self.state.getNU(), 0.0)
        path = opensim.GeometryPath.safeDownCast(muscle.updPath())
        path.addInEquivalentForces(self.state, 1.0, wrenches, mobility)
        force = opensim.Vector()
        self.matter.multiplyBySystemJacobianTranspose(self.state, wrenches, force)
        return (force.to_numpy() + mobility.to_numpy()).tolist()

    def maps(self, active: Array, passive: Array) -> dict[str, Any]:
        controls = np.zeros(len(self.muscles) + len(self.actuators))
        acceleration, reaction = self.respond(controls, active, passive)
        multipliers = self.state.getMultipliers().to_numpy()
        columns = []
        for index in range(len(controls)):
            unit = np.zeros_like(controls)
            unit[index] = 1.0
            columns.append(self.respond(unit, active, passive))
        return {
            "multipliers_at_rest": multipliers.tolist(),
            "acceleration_at_rest": acceleration.tolist(),
            "acceleration_per_control": np.array([a - acceleration for a, _ in columns]).T.tolist(),
            "reaction_at_rest": reaction.tolist(),
            "reaction_per_control": np.array([r - reaction for _, r in columns]).T.tolist(),
        }

    def respond(self, controls: Array, active: Array, passive: Array) -> tuple[Array, Array]:
        state, count = self.state, len(self.muscles)
        for muscle, tension in zip(self.muscles, active * controls[:count] + passive, strict=True):
            muscle.setOverrideActuation(state, float(tension))
        applied = self.osim.updControls(state)
        for actuator, control in zip(self.actuators, controls[count:], strict=True):
            actuator.setControls(opensim.Vector(1, float(control)), applied)
        self.osim.realizeVelocity(state)
        self.osim.setControls(state, applied)
        self.osim.realizeAcceleration(state)
        wrench = self.osim.getJointSet().get("GlenoHumeral").calcReactionOnParentExpressedInGround(state)
        acceleration = [coordinate.getAccelerationValue(state) for coordinate in self.coordinates]
        return np.array(acceleration), np.array(_values(wrench.get(0)) + _values(wrench.get(1)))


def build(model: Model) -> Any:
    """The model as OpenSim has it, component by component."""
    osim = opensim.Model()
    osim.setName(model.name)
    osim.setGravity(_vec3(model.gravity))
    frames = [osim.getGround()]
    for body in model.bodies[1:]:
        xx, yy, zz, xy, xz, yz = (float(body.inertia[i]) for i in ((0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)))
        inertia = opensim.Inertia(xx, yy, zz, xy, xz, yz)
        frames.append(opensim.Body(body.name, body.mass, _vec3(body.mass_center), inertia))
        osim.addBody(frames[-1])
    for joint in model.joints:
        _add_joint(osim, model, joint, frames)
    surfaces = [add_surface(frames[surface.body], surface) for surface in model.surfaces]
    for constraint in model.constraints:
        ends = (frames[constraint.body_1], _vec3(constraint.location_1))
        others = (frames[constraint.body_2], _vec3(constraint.location_2))
        held = opensim.PointConstraint(*ends, *others)
        held.setName(constraint.name)
        osim.addConstraint(_given(held))
    osim.finalizeConnections()
    for muscle in model.muscles:
        _add_muscle(osim, model, muscle, frames, surfaces)
    for actuator in model.actuators:
        pusher = opensim.CoordinateActuator(model.coordinates[actuator.coordinate].name)
        pusher.setName(actuator.name)
        pusher.setOptimalForce(actuator.optimal_force)
        osim.addForce(_given(pusher))
    for marker in model.markers:
        osim.addMarker(_given(opensim.Marker(marker.name, frames[marker.body], _vec3(marker.location))))
    osim.finalizeConnections()
    return osim


def _read(file: Path) -> Any:
    osim = opensim.Model(str(file))
    for muscle in osim.getMuscles():
        millard = opensim.Millard2012EquilibriumMuscle.safeDownCast(muscle)
        millard.set_ignore_tendon_compliance(True)
        millard.set_ignore_activation_dynamics(True)
    return osim


def _add_joint(osim: Any, model: Model, joint: Any, frames: list[Any]) -> None:
    sides = (
        *(frames[joint.parent], *_pose(joint.frame_in_parent)),
        *(frames[joint.child], *_pose(joint.frame_in_child)),
    )
    motion = joint.motion
    if isinstance(motion, AxisMotion):
        driven = [int(c) for c in motion.coordinate if c >= 0]
        if driven:
            made = opensim.CustomJoint(joint.name, *sides, _spatial_transform(model, motion))
        else:
            made = opensim.WeldJoint(joint.name, *sides)
    else:
        driven = list(motion.coordinates)
        origin = opensim.Vec2(*map(float, motion.winging_origin))
        radii, direction = _vec3(motion.radii), motion.winging_direction
        made = opensim.ScapulothoracicJoint(joint.name, *sides, radii, origin, direction)
    made.finalizeFromProperties()
    for index, coordinate in enumerate(model.coordinates[c] for c in driven):
        its = made.upd_coordinates(index)
        its.setName(coordinate.name)
        its.setRangeMin(coordinate.range[0])
        its.setRangeMax(coordinate.range[1])
        its.setDefaultValue(coordinate.default)
        its.setDefaultClamped(False)
    osim.addJoint(_given(made))


def _spatial_transform(model: Model, motion: AxisMotion) -> Any:
    transform = opensim.SpatialTransform()
    for index, coordinate in enumerate(motion.coordinate):
        axis = transform.updTransformAxis(index)
        axis.setAxis(_vec3(motion.axes[index]))
        offset, slope, _ = (float(values[0]) for values in motion.functions[index].derivatives(np.zeros(1)))
        if coordinate >= 0:
            axis.setCoordinateNames(opensim.ArrayStr(model.coordinates[coordinate].name, 1))
            axis.set_function(opensim.LinearFunction(slope, offset))
        else:
            axis.set_function(opensim.Constant(offset))
    return transform


def add_surface(body: Any, surface: WrapSurface) -> Any:
    if surface.kind == "ellipsoid":
        made = opensim.WrapEllipsoid()
        made.set_dimensions(_vec3(surface.dimensions))
    elif surface.kind == "sphere":
        made = opensim.WrapSphere()
        made.set_radius(float(surface.dimensions[0]))
    else:
        made = opensim.WrapCylinder()
        made.set_radius(float(surface.dimensions[0]))
        made.set_length(float(surface.dimensions[2]))
    made.setName(surface.name)
    translation, angles = _pose(surface.placement)
    made.set_translation(translation)
    made.set_xyz_body_rotation(angles)
    made.set_quadrant(surface.quadrant)
    body.addWrapObject(_given(made))
    return made


def _add_muscle(osim: Any, model: Model, muscle: Muscle, frames: list[Any], surfaces: list[Any]) -> None:
    made = opensim.Millard2012EquilibriumMuscle(
        muscle.name,
        muscle.max_isometric_force,
        muscle.optimal_fiber_length,
        muscle.tendon_slack_length,
        muscle.pennation_at_optimal,
    )
    made.setMaxContractionVelocity(muscle.max_contraction_velocity)
    made.set_ignore_tendon_compliance(True)
    made.set_ignore_activation_dynamics(True)
    made.upd_ActiveForceLengthCurve().setMinValue(0.0)
    path = opensim.GeometryPath.safeDownCast(made.updPath())
    for index, point in enumerate(muscle.path.points):
        name = f"{muscle.name}-P{index + 1}"
        if isinstance(point, PathPoint):
            path.appendNewPathPoint(name, frames[point.body], _vec3(point.location))
        else:
            path.updPathPointSet().adoptAndAppend(_given(_moving_point(osim, model, point, frames, name)))
    for index, wrap in enumerate(muscle.path.wraps):
        path.addPathWrap(surfaces[wrap.surface])
        path.updWrapSet().get(index).setName(f"{muscle.name}-wrap{index + 1}")
        path.updWrapSet().get(index).set_method(wrap.method)
    osim.addForce(_given(made))


def _moving_point(osim: Any, model: Model, point: MovingPathPoint, frames: list[Any], name: str) -> Any:
    moving = opensim.MovingPathPoint()
    moving.setName(name)
    moving.setParentFrame(frames[point.body])
    coordinate = osim.getCoordinateSet().get(model.coordinates[point.coordinate].name)
    for axis, function in zip("xyz", point.functions, strict=True):
        start, slope, _ = (float(values[0]) for values in function.derivatives(np.zeros(1)))
        getattr(moving, f"connectSocket_{axis}_coordinate")(coordinate)
        getattr(moving, f"set_{axis}_location")(opensim.LinearFunction(slope, start))
    return moving


def _pose(placement: Placement) -> tuple[Any, Any]:
    """Translation and the body-fixed x-y-z angles of a placement."""
    r = placement.rotation
    angles = (np.arctan2(-r[1, 2], r[2, 2]), np.arcsin(np.clip(r[0, 2], -1.0, 1.0)), np.arctan2(-r[0, 1], r[0, 0]))
    return _vec3(placement.translation), _vec3(angles)


def _vec3(values: Any) -> Any:
    return opensim.Vec3(*(float(value) for value in values))


def _values(vector: Any) -> list[float]:
    return [float(vector.get(i)) for i in range(3)]


def _given(component: Any) -> Any:
    """Hands the component's memory to OpenSim, which deletes what is added to it."""
    component.thisown = False
    return component


if __name__ == "__main__":
    main()
