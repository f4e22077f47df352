"""What muscles can pull, read from a file, against OpenSim."""

from __future__ import annotations

import itertools
import re
import xml.etree.ElementTree as Xml
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.functions.muscle_curves import SchutteCurves
from solver.model import Model
from solver.multibody.postures import postures
from solver.muscle import MuscleForces, muscle_forces
from solver.osim.model_reader import read_osim
from solver.osim.model_writer import osim_document
from solver.paths import evaluate_paths
from tests.solver.oracle.two_bodies import given, model_with, opensim, random_states, read_back

pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]
# optimal fibre length and tendon slack length [m], pennation [rad]: from slack to far beyond the curves' ends
FIBERS = [(0.2, 0.15, 0.0), (0.2, 0.15, 0.3), (0.1, 0.2, 0.2), (0.3, 0.05, 0.0), (0.12, 0.5, 0.4), (0.4, 0.1, 0.6)]
MILLARD = {
    "OpenSim's own curves": {},
    "another active curve": {"active": (0.4, 0.7, 1.9, 0.75, 0.05)},
    "another speed curve": {"speed": (0.05, 0.2, 4.0, 0.02, 0.1, 1.6, 0.4, 0.7)},
    "a sharp speed curve": {"speed": (0.0, 0.25, 5.0, 0.0, 0.15, 1.4, 0.0, 1.0)},
    "another passive curve": {"passive": (0.1, 0.5, 0.3, 6.0, 0.4)},
    "a passive curve by its strains": {"passive": (0.05, 0.6)},
}


@pytest.mark.parametrize("name", MILLARD)
def test_a_millard_muscle(name: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    for index, fiber in enumerate(FIBERS):
        muscle = opensim.Millard2012EquilibriumMuscle(f"millard_{index}", 300.0, *fiber)
        muscle.set_ignore_tendon_compliance(True)
        muscle.set_ignore_activation_dynamics(True)
        muscle.set_maximum_pennation_angle(1.2)
        bend(muscle, **MILLARD[name])
        span(model, muscle)
    ours, forces, theirs = both(model, tmp_path, rigid_factors)
    assert np.abs(factors(forces)[:, 1:] - theirs[:, 1:]).max() < 1e-12
    assert len(ours.muscles) == 1 + len(FIBERS)


def test_a_thelen_muscle(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    for index, fiber in enumerate(FIBERS):
        muscle = opensim.Thelen2003Muscle(f"thelen_{index}", 300.0, *fiber)
        if index % 2:
            muscle.set_FmaxMuscleStrain(0.5)
            muscle.set_KshapeActive(0.5)
            muscle.set_KshapePassive(4.0)
            muscle.set_Af(0.3)
            muscle.set_Flen(1.7)
            muscle.set_fv_linear_extrap_threshold(0.9)
        span(model, muscle)
    _, forces, theirs = both(model, tmp_path, thelen_forces)
    strength = 300.0
    assert np.abs(forces.active[:, 1:] - theirs[:, 1:, 0]).max() / strength < 1e-10
    assert np.allclose(forces.passive_factor[:, 1:], theirs[:, 1:, 1], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("is_changed", [False, True])
def test_a_de_groote_fregly_muscle(is_changed: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    for index, (optimal, slack, pennation) in enumerate(FIBERS):
        muscle = opensim.DeGrooteFregly2016Muscle()
        muscle.setName(f"de_groote_{index}")
        muscle.set_max_isometric_force(300.0)
        muscle.set_optimal_fiber_length(optimal)
        muscle.set_tendon_slack_length(slack)
        muscle.set_pennation_angle_at_optimal(pennation)
        muscle.set_ignore_tendon_compliance(True)
        muscle.set_ignore_activation_dynamics(True)
        if is_changed:
            muscle.set_active_force_width_scale(1.3)
            muscle.set_passive_fiber_strain_at_one_norm_force(0.5)
            muscle.set_ignore_passive_fiber_force(index % 2 == 1)
        span(model, muscle)
    ours, forces, theirs = both(model, tmp_path, rigid_factors)
    is_stretched = lengths_of(ours, 1)[0] > [slack for _, slack, _ in FIBERS]  # OpenSim's fibres push if they are not
    assert is_stretched.sum() > 100
    np.testing.assert_allclose(
        factors(forces)[:, 1:][is_stretched], theirs[:, 1:][is_stretched], rtol=1e-12, atol=1e-12
    )


@pytest.mark.parametrize(
    "curves",
    [
        "",
        """<SimmSpline name="active_force_length_curve"><x>-9 0 0.4 0.7 1 1.3 1.6 9</x><y>0 0 0 0.8 1 0.7 0 0</y>
        </SimmSpline><SimmSpline name="passive_force_length_curve"><x>-35 1 1.15 1.15 1.25 1.75 35</x>
        <y>0 0 0 0 0.035 2 2</y></SimmSpline>""",
    ],
)
def test_a_schutte_muscle(curves: str, tmp_path: Path) -> None:
    """OpenSim has its fibre length for a state and solves its curves for the fibre's speed; damping is left out."""
    source, file = model_with(opensim.UniversalJoint), tmp_path / "schutte.osim"
    for index, fiber in enumerate(FIBERS[:3]):
        span(source, opensim.Millard2012EquilibriumMuscle(f"schutte_{index}", 300.0, *fiber))
    source.finalizeConnections()
    source.printToXML(str(file))
    text = re.sub(
        r"<(/?)Millard2012EquilibriumMuscle(?! name=.pull)", r"<\1Schutte1993Muscle_Deprecated", file.read_text()
    )
    text = text.replace("</Schutte1993Muscle_Deprecated>", "</Millard2012EquilibriumMuscle>", 1)
    text = text.replace(
        "</Schutte1993Muscle_Deprecated>", f"<damping>0.05</damping>{curves}</Schutte1993Muscle_Deprecated>"
    )
    file.write_text(text)
    theirs, ours = opensim.Model(str(file)), read_osim(file)
    assert [type(muscle.curves) for muscle in ours.muscles[1:]] == [SchutteCurves] * 3
    state, coordinate = theirs.initSystem(), theirs.getCoordinateSet().get(0)
    lengths, activations = np.linspace(0.5, 1.6, 12), np.array([0.3, 1.0])
    for muscle in ours.muscles[1:]:
        expected = theirs.getMuscles().get(muscle.name)
        rows = []
        for activation, length in itertools.product(activations, lengths):
            for name, value in (("activation", activation), ("fiber_length", length * muscle.optimal_fiber_length)):
                theirs.setStateVariableValue(state, f"{expected.getAbsolutePathString()}/{name}", float(value))
            coordinate.setValue(state, coordinate.getValue(state), False)  # or OpenSim keeps the last fibre length
            theirs.realizeAcceleration(state)
            speed = theirs.getStateVariableDerivativeValue(state, f"{expected.getAbsolutePathString()}/fiber_length")
            along = expected.getActuation(state) / muscle.max_isometric_force / expected.getCosPennationAngle(state)
            active, passive = expected.getActiveForceLengthMultiplier(state), expected.getPassiveForceMultiplier(state)
            rows.append((activation, length, active, passive, speed / muscle.optimal_fiber_length, along - passive))
        activation, length, active, passive, speed, force = np.array(rows).T
        curves = muscle.curves
        np.testing.assert_allclose(curves.active_force_length(length), np.maximum(active, 0.0), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(curves.passive_force_length(length), passive, rtol=1e-12, atol=1e-12)
        speed = speed / muscle.max_contraction_velocity
        balanced = activation * curves.active_force_length(length) * curves.force_velocity(speed) + 0.05 * speed
        is_pulled = force > 0.0  # OpenSim takes no fibre for one that pushes
        np.testing.assert_allclose(balanced[is_pulled], force[is_pulled], rtol=1e-9, atol=1e-11)
        assert is_pulled.sum() > 8 and np.ptp(speed[is_pulled]) > 0.5


def test_muscles_of_both_kinds_in_one_model(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    span(model, opensim.Thelen2003Muscle("thelen", 300.0, *FIBERS[0]))
    span(model, opensim.Millard2012EquilibriumMuscle("millard", 300.0, *FIBERS[0]))
    ours = read_back(model, tmp_path)
    together = forces_of(ours)
    for index, muscle in enumerate(ours.muscles):
        alone = muscle_forces(Model(**vars(ours) | {"muscles": (muscle,)}), *lengths_of(ours, index))
        assert np.array_equal(together.active[:, index], alone.active[:, 0])


def bend(muscle: Any, active: Any = None, speed: Any = None, passive: Any = None) -> None:
    if active is not None:
        muscle.setActiveForceLengthCurve(opensim.ActiveForceLengthCurve(*active))
    if speed is not None:
        muscle.setForceVelocityCurve(opensim.ForceVelocityCurve(*speed))
    if passive is not None:
        curve = opensim.FiberForceLengthCurve()
        curve.set_strain_at_zero_force(passive[0])
        curve.set_strain_at_one_norm_force(passive[1])
        if len(passive) > 2:
            curve.setOptionalProperties(*passive[2:])
        muscle.setFiberForceLengthCurve(curve)


def span(model: Any, muscle: Any) -> None:
    """From the ground to the second body."""
    model.addForce(given(muscle))
    path = opensim.GeometryPath.safeDownCast(muscle.updPath())
    path.appendNewPathPoint("start", model.getGround(), opensim.Vec3(0.05, 0.1, 0.02))
    path.appendNewPathPoint("end", model.getBodySet().get("lower"), opensim.Vec3(0.02, -0.2, 0.0))


def both(model: Any, folder: Path, of_opensim: Any) -> tuple[Model, MuscleForces, Array]:
    ours = read_back(model, folder)
    state = model.initSystem()
    coordinates = [model.getCoordinateSet().get(name) for name in ours.coordinate_names]
    rows = []
    for values, speeds in zip(*random_states(ours), strict=True):
        for coordinate, value, speed in zip(coordinates, values, speeds, strict=True):
            coordinate.setValue(state, float(value), False)
            coordinate.setSpeedValue(state, float(speed))
        model.realizeVelocity(state)
        rows.append([of_opensim(model.getMuscles().get(name), state, ours) for name in ours.muscle_names])
    return ours, forces_of(ours), np.array(rows)


def forces_of(model: Model) -> MuscleForces:
    paths = evaluate_paths(model, postures(model, *random_states(model)))
    return muscle_forces(model, paths.lengths, paths.speeds)


def lengths_of(model: Model, muscle: int) -> tuple[Array, Array]:
    paths = evaluate_paths(model, postures(model, *random_states(model)))
    return paths.lengths[:, [muscle]], paths.speeds[:, [muscle]]


def factors(forces: MuscleForces) -> Array:
    values = (forces.length_factor, forces.velocity_factor, forces.passive_factor, forces.cos_pennation)
    return np.stack(values, axis=-1)


def rigid_factors(muscle: Any, state: Any, _model: Model) -> list[float]:
    return [
        muscle.getActiveForceLengthMultiplier(state),
        muscle.getForceVelocityMultiplier(state),
        muscle.getPassiveForceMultiplier(state),
        muscle.getCosPennationAngle(state),
    ]


def thelen_forces(muscle: Any, state: Any, _model: Model) -> list[float]:
    """At full activation on a tendon that does not stretch, and passively at the same fibre length."""
    thelen = opensim.Thelen2003Muscle.safeDownCast(muscle)
    if thelen is None:
        return [np.nan, np.nan]
    active = thelen.calcInextensibleTendonActiveFiberForce(state, 1.0)
    height = thelen.getOptimalFiberLength() * np.sin(thelen.getPennationAngleAtOptimalFiberLength())
    along = max(thelen.getLength(state) - thelen.getTendonSlackLength(), 0.0)
    thelen.setFiberLength(state, float(np.hypot(height, along)))
    return [active, thelen.getPassiveForceMultiplier(state)]


@pytest.mark.parametrize("kind", ["Millard2012EquilibriumMuscle", "DeGrooteFregly2016Muscle"])
def test_without_activation_dynamics_an_activation_is_the_excitation_at_once(kind: str, tmp_path: Path) -> None:
    """OpenSim has no state for it, and neither a time constant here; a file that the solver writes says so, too."""
    model = model_with(opensim.UniversalJoint)
    for name, is_ignored in (("at_once", True), ("delayed", False)):
        muscle = getattr(opensim, kind)()
        muscle.setName(name)
        muscle.set_ignore_tendon_compliance(True)
        muscle.set_ignore_activation_dynamics(is_ignored)
        span(model, muscle)
    ours = read_back(model, tmp_path)
    written = tmp_path / "written.osim"
    Xml.ElementTree(osim_document(ours)).write(written, encoding="utf-8")
    for file, read in ((tmp_path / "two_bodies.osim", ours), (written, read_osim(written))):
        theirs = opensim.Model(str(file))
        state = theirs.initSystem()
        constants = {
            muscle.name: (muscle.activation_time_constant, muscle.deactivation_time_constant) for muscle in read.muscles
        }
        names = theirs.getStateVariableNames()
        states = " ".join(names.get(index) for index in range(names.getSize()))
        for name in ("at_once", "delayed"):
            assert (constants[name] == (0.0, 0.0)) == (f"{name}/activation" not in states)
        theirs.realizeVelocity(state)
        controls = theirs.updControls(state)
        for index in range(controls.size()):
            controls[index] = 0.37
        theirs.setControls(state, controls)
        assert theirs.getMuscles().get("at_once").getActivation(state) == pytest.approx(0.37)
        assert theirs.getMuscles().get("delayed").getActivation(state) != pytest.approx(0.37)
