"""Muscles with elastic tendons against OpenSim's: tendon curves, equilibrium at rest, and forward simulation."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.functions.muscle_curves import DeGrooteFreglyTendon, MillardCurves, MillardTendon, ThelenTendon
from solver.model import Model
from solver.osim.model_reader import read_osim
from solver.tendons.evaluation import ElasticForces, elastic_forces
from tests.solver.oracle.two_bodies import given, opensim, vec3
from tests.solver.refusals import raises_refusal

pytestmark = pytest.mark.oracle

Array = NDArray[np.float64]

STRENGTH, DURATION = 900.0, 0.8
SETTLING = 0.1  # s, after which the transient of the first frames has decayed
FIBERS = {"long tendon": (0.06, 0.3, 0.35), "short tendon": (0.12, 0.06, 0.0)}
"""Optimal fibre length and tendon slack length [m], pennation [rad]."""
KINDS = ("Millard2012EquilibriumMuscle", "Thelen2003Muscle", "DeGrooteFregly2016Muscle")


@dataclass(frozen=True)
class Course:
    """Path length [m] as offset + amplitude sin(ω t), activation as mean + swing sin(ω t + 1)."""

    offset: float
    amplitude: float
    frequency: float
    mean: float = 0.4
    swing: float = 0.35

    def lengths(self, time: Array) -> Array:
        return self.offset + self.amplitude * np.sin(self.frequency * time)

    def speeds(self, time: Array) -> Array:
        return self.amplitude * self.frequency * np.cos(self.frequency * time)

    def activations(self, time: Array) -> Array:
        return self.mean + self.swing * np.sin(self.frequency * time + 1.0)


def muscle_of(kind: str, fiber: tuple[float, float, float]) -> Any:
    muscle = getattr(opensim, kind)()
    muscle.setName("muscle")
    muscle.set_max_isometric_force(STRENGTH)
    muscle.set_optimal_fiber_length(fiber[0])
    muscle.set_tendon_slack_length(fiber[1])
    muscle.set_pennation_angle_at_optimal(fiber[2])
    muscle.set_ignore_activation_dynamics(True)
    if kind == "Thelen2003Muscle":
        muscle.set_ignore_activation_dynamics(False)  # it always has them
    return muscle


def model_of(muscle: Any, course: Course) -> Any:
    """The muscle between the ground and a block that slides along x as the course says."""
    model = opensim.Model()
    model.setName("slide")
    block = opensim.Body("block", 1.0, vec3(0, 0, 0), opensim.Inertia(1.0))
    model.addBody(given(block))
    joint = opensim.SliderJoint("slider", model.getGround(), block)
    coordinate = joint.updCoordinate()
    coordinate.setName("x")
    coordinate.setPrescribedFunction(opensim.Sine(course.amplitude, course.frequency, 0.0, course.offset))
    coordinate.setDefaultIsPrescribed(True)
    model.addJoint(given(joint))
    model.addForce(given(muscle))
    path = opensim.GeometryPath.safeDownCast(muscle.updPath())
    path.appendNewPathPoint("start", model.getGround(), vec3(0, 0, 0))
    path.appendNewPathPoint("end", block, vec3(0, 0, 0))
    controller = opensim.PrescribedController()
    controller.addActuator(muscle)
    control = opensim.Sine(course.swing, course.frequency, 1.0, course.mean)
    controller.prescribeControlForActuator("muscle", given(control))
    model.addController(given(controller))
    model.finalizeConnections()
    return model


def read_slide(model: Any, folder: Path) -> Model:
    file = folder / "slide.osim"
    model.printToXML(str(file))
    file.write_text(file.read_text().replace("<prescribed>true", "<prescribed>false"))
    return read_osim(file, ignore_forces=True)


@dataclass(frozen=True)
class Simulation:
    """Of OpenSim: tendon force [N] and activation at the times, fibre lengths [m]."""

    time: Array
    force: Array
    activation: Array
    fiber: Array

    def ours(self, model: Model, course: Course, every: int) -> ElasticForces:
        """The same at every n-th of its times."""
        time, activations = self.time[::every], self.activation[::every]
        lengths, speeds = course.lengths(time), course.speeds(time)
        columns = (lengths[:, None], speeds[:, None], activations[:, None])
        return elastic_forces(model, *columns, time[1] - time[0], self.fiber[:1])


def simulate(model: Any, time: Array) -> Simulation:
    """OpenSim's forward simulation from its equilibrium at the first time."""
    state = model.initSystem()
    muscle = model.getMuscles().get(0)
    model.equilibrateMuscles(state)
    manager = opensim.Manager(model)
    manager.setIntegratorMethod(opensim.Manager.IntegratorMethod_RungeKuttaFeldberg)
    manager.setIntegratorAccuracy(1e-9)
    manager.initialize(state)
    rows = []
    for instant in time:
        if instant > time[0]:
            state = manager.integrate(float(instant))
        model.realizeDynamics(state)
        rows.append((muscle.getTendonForce(state), muscle.getActivation(state), muscle.getFiberLength(state)))
    return Simulation(time, *np.array(rows).T)


@pytest.mark.parametrize("fiber", FIBERS)
@pytest.mark.parametrize("kind", KINDS)
def test_forces_are_those_of_a_forward_simulation(kind: str, fiber: str, tmp_path: Path) -> None:
    """The error falls with the square of the interval; extrapolated to an interval of zero, hardly any remains."""
    optimal, slack, _ = FIBERS[fiber]
    course = Course(slack + 0.95 * optimal, 0.2 * optimal, 2 * np.pi / DURATION)
    model = model_of(muscle_of(kind, FIBERS[fiber]), course)
    expected = simulate(model, np.linspace(0.0, DURATION, 801))
    ours = read_slide(model, tmp_path)
    coarse, fine = (expected.ours(ours, course, every) for every in (2, 1))
    assert fine.is_converged.all() and not fine.is_shortest.any()
    known = expected.force[::2]
    errors = (coarse.tension[:, 0] - known) / STRENGTH, (fine.tension[::2, 0] - known) / STRENGTH
    settled = expected.time[::2] > SETTLING
    first, second = (np.linalg.norm(error[settled]) for error in errors)
    assert 3.4 < first / second < 4.6
    assert np.abs(errors[1][settled]).max() < 2e-4
    assert np.abs((4 * errors[1] - errors[0]) / 3)[settled].max() < 6e-5


@pytest.mark.parametrize("fiber", FIBERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_muscle_at_rest_is_in_the_equilibrium_of_opensim(kind: str, fiber: str, tmp_path: Path) -> None:
    """To the tolerance of OpenSim's search."""
    optimal, slack, _ = FIBERS[fiber]
    for length in (0.7, 0.95, 1.15, 1.4):
        course = Course(slack + length * optimal, 0.0, 1.0)
        model = model_of(muscle_of(kind, FIBERS[fiber]), course)
        state = model.initSystem()
        muscle = model.getMuscles().get(0)
        muscle.setActivation(state, 0.5)
        control = muscle.getActivation(state)
        model.equilibrateMuscles(state)
        model.realizeDynamics(state)
        columns = [np.array([[value]]) for value in (course.offset, 0.0, control)]
        found = elastic_forces(read_slide(model, tmp_path), *columns, 0.01)
        assert found.tension[0, 0] == pytest.approx(muscle.getTendonForce(state), abs=1e-5 * STRENGTH)
        assert found.fiber_lengths[0, 0] == pytest.approx(muscle.getFiberLength(state), abs=1e-6 * optimal)
        assert found.tendon_strain[0, 0] == pytest.approx(muscle.getTendonStrain(state), abs=1e-6)


@pytest.mark.parametrize("least", [0.0, 0.1, 0.2])
def test_an_active_curve_that_does_not_end_at_zero(least: float) -> None:
    """As of a muscle with an elastic tendon and without damping."""
    theirs = opensim.ActiveForceLengthCurve(0.4441, 0.73, 1.8123, 0.8616, least)
    lengths = np.linspace(0.3, 2.0, 171)
    ours = MillardCurves(minimum=least).active_force_length(lengths)
    np.testing.assert_allclose(ours, [theirs.calcValue(x) for x in lengths], rtol=0, atol=1e-12)


@pytest.mark.parametrize("figures", [(), (0.06,), (0.033, 45.0, 0.5, 0.3)])
def test_a_tendon_curve_of_millard(figures: tuple[float, ...], tmp_path: Path) -> None:
    muscle = muscle_of(KINDS[0], FIBERS["long tendon"])
    curve = opensim.TendonForceLengthCurve(*figures)
    muscle.setTendonForceLengthCurve(curve)
    tendon = read_slide(model_of(muscle, Course(0.3, 0.0, 1.0)), tmp_path).muscles[0].tendon
    assert isinstance(tendon, MillardTendon)
    lengths = np.linspace(0.98, 1.1, 241)
    np.testing.assert_allclose(tendon.force(lengths), [curve.calcValue(x) for x in lengths], rtol=0, atol=1e-12)


def test_a_tendon_curve_of_de_groote_and_fregly(tmp_path: Path) -> None:
    muscle = muscle_of(KINDS[2], FIBERS["long tendon"])
    muscle.set_tendon_strain_at_one_norm_force(0.07)
    model = model_of(muscle, Course(0.3, 0.0, 1.0))  # kept, because it owns the muscle
    tendon = read_slide(model, tmp_path).muscles[0].tendon
    assert isinstance(tendon, DeGrooteFreglyTendon)
    lengths = np.linspace(0.98, 1.1, 25)
    expected = [muscle.calcTendonForceMultiplier(x) for x in lengths]
    np.testing.assert_allclose(tendon.force(lengths), expected, rtol=1e-12, atol=1e-13)


def test_a_tendon_curve_of_thelen(tmp_path: Path) -> None:
    """Seen as the tendon's force at given fibre lengths."""
    optimal, slack, _ = fiber = 0.1, 0.3, 0.0
    muscle = muscle_of(KINDS[1], fiber)
    muscle.set_FmaxTendonStrain(0.05)
    model = model_of(muscle, Course(slack + optimal, 0.0, 1.0))
    tendon = read_slide(model, tmp_path).muscles[0].tendon
    assert isinstance(tendon, ThelenTendon)
    state = model.initSystem()
    muscle = opensim.Thelen2003Muscle.safeDownCast(model.getMuscles().get(0))
    for length in np.linspace(0.75, 1.05, 13):
        muscle.setFiberLength(state, float(length * optimal))
        model.realizeDynamics(state)
        stretched = np.array([muscle.getTendonLength(state) / slack])
        assert tendon.force(stretched)[0] == pytest.approx(muscle.getTendonForce(state) / STRENGTH, abs=1e-12)


@pytest.mark.parametrize("kind", KINDS)
def test_a_tendon_that_the_file_has_rigid_stays_so(kind: str, tmp_path: Path) -> None:
    muscle = muscle_of(kind, FIBERS["long tendon"])
    muscle.set_ignore_tendon_compliance(True)
    ours = read_slide(model_of(muscle, Course(0.35, 0.0, 1.0)), tmp_path)
    assert ours.muscles[0].tendon is None
    with raises_refusal(SolverCode.NO_TENDON, naming="slide"):
        elastic_forces(ours, *np.full((3, 1, 1), 0.3), 0.01)


def test_a_fibre_at_its_least_length_is_held_as_in_opensim(tmp_path: Path) -> None:
    optimal, slack, _ = FIBERS["short tendon"]
    course = Course(slack + 0.55 * optimal, 0.25 * optimal, 2 * np.pi / DURATION, 0.5, 0.0)
    muscle = muscle_of(KINDS[0], FIBERS["short tendon"])
    muscle.set_fiber_damping(0.0)  # with damping a fibre that gives no force gets there in seconds
    model = model_of(muscle, course)
    expected = simulate(model, np.linspace(0.0, DURATION, 401))
    found = expected.ours(read_slide(model, tmp_path), course, 1)
    held = found.is_shortest[:, 0]
    assert 20 < held.sum() < 300
    np.testing.assert_allclose(found.fiber_lengths[held, 0], 0.4441 * optimal, rtol=1e-12)
    np.testing.assert_allclose(expected.fiber[held], 0.4441 * optimal, rtol=2e-2)
    np.testing.assert_allclose(found.tension[:, 0], expected.force, atol=5e-3 * STRENGTH)
