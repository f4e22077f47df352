"""Muscles read from a file against OpenSim: forces, pennation and elastic tendons."""

import itertools
import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.functions.muscle_curves import (
    DeGrooteFreglyTendon,
    MillardCurves,
    MillardTendon,
    SchutteCurves,
    ThelenTendon,
)
from solver.model import Array, Model
from solver.multibody.postures import postures
from solver.muscle import MuscleForces, PathState, evaluate_paths, muscle_forces
from solver.osim.model_reader import read_osim
from solver.tendons.fiber import ElasticForces, elastic_forces
from tests.refusals import raises_refusal
from tests.solver.oracle.two_bodies import (
    given,
    idle_states,
    made,
    model_with,
    opensim,
    path_of,
    printed,
    random_states,
    read_back,
    span,
    vec3,
    written,
)

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
RIGHT_ANGLE = float(np.pi / 2)
KINDS = ("Millard2012EquilibriumMuscle", "Thelen2003Muscle", "DeGrooteFregly2016Muscle")
STRENGTH, DURATION = 900.0, 0.8
SETTLING = 0.1  # s, after which the transient of the first frames has decayed
TENDON_FIBERS = {"long tendon": (0.06, 0.3, 0.35), "short tendon": (0.12, 0.06, 0.0)}
"""Optimal fibre length and tendon slack length [m], pennation [rad]."""


RIGID = {"set_ignore_tendon_compliance": True, "set_ignore_activation_dynamics": True}


def fiber_settings(optimal: float, slack: float, pennation: float, strength: float = 300.0) -> dict[str, float]:
    return {
        "set_max_isometric_force": strength,
        "set_optimal_fiber_length": optimal,
        "set_tendon_slack_length": slack,
        "set_pennation_angle_at_optimal": pennation,
    }


@pytest.mark.parametrize("name", MILLARD)
def test_a_millard_muscle(name: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    for index, fiber in enumerate(FIBERS):
        settings = {**RIGID, **fiber_settings(*fiber), "set_maximum_pennation_angle": 1.2}
        bend(span(model, made(KINDS[0], f"millard_{index}", **settings)), **MILLARD[name])
    ours, forces, theirs = both(model, tmp_path, rigid_factors)
    assert np.abs(per_strength(ours, forces)[:, 1:] - theirs[:, 1:]).max() < 1e-12
    assert len(ours.muscles) == 1 + len(FIBERS)


def test_a_thelen_muscle(tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    changes = {"set_FmaxMuscleStrain": 0.5, "set_KshapeActive": 0.5, "set_KshapePassive": 4.0, "set_Af": 0.3}
    changes |= {"set_Flen": 1.7, "set_fv_linear_extrap_threshold": 0.9}
    for index, fiber in enumerate(FIBERS):
        settings = fiber_settings(*fiber) | (changes if index % 2 else {})
        span(model, made(KINDS[1], f"thelen_{index}", **settings))
    _, forces, theirs = both(model, tmp_path, thelen_forces)
    assert np.abs(forces.active[:, 1:] - theirs[:, 1:, 0]).max() / 300.0 < 1e-10
    passive = theirs[:, 1:, 1] * forces.cos_pennation[:, 1:]
    assert np.allclose(forces.passive[:, 1:] / 300.0, passive, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("is_changed", [False, True])
def test_a_de_groote_fregly_muscle(is_changed: bool, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    changes = {"set_active_force_width_scale": 1.3, "set_passive_fiber_strain_at_one_norm_force": 0.5}
    for index, fiber in enumerate(FIBERS):
        ignored = {"set_ignore_passive_fiber_force": index % 2 == 1}
        settings = RIGID | fiber_settings(*fiber) | (changes | ignored if is_changed else {})
        span(model, made(KINDS[2], f"de_groote_{index}", **settings))
    ours, forces, theirs = both(model, tmp_path, rigid_factors)
    is_stretched = paths_of(ours).lengths[:, [1]] > [slack for _, slack, _ in FIBERS]  # else OpenSim's fibres push
    assert is_stretched.sum() > 100
    found, expected = per_strength(ours, forces)[:, 1:][is_stretched], theirs[:, 1:][is_stretched]
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12)


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
    source = model_with(opensim.UniversalJoint)
    for index, fiber in enumerate(FIBERS[:3]):
        span(source, made(KINDS[0], f"schutte_{index}", **fiber_settings(*fiber)))
    file = printed(source, tmp_path / "schutte.osim")
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


def both(model: Any, folder: Path, of_opensim: Any) -> tuple[Model, MuscleForces, Array]:
    ours, rows = read_back(model, folder), []
    for state in idle_states(model, ours.coordinate_names, *random_states(ours)):
        model.realizeVelocity(state)
        rows.append([of_opensim(model.getMuscles().get(name), state, ours) for name in ours.muscle_names])
    paths = paths_of(ours)
    return ours, muscle_forces(ours, paths.lengths, paths.speeds), np.array(rows)


def paths_of(model: Model) -> PathState:
    return evaluate_paths(model, postures(model, *random_states(model)))


def per_strength(model: Model, forces: MuscleForces) -> Array:
    """(frames, muscles, 3) active and passive force over the greatest isometric one, and cos(pennation)."""
    strength = [muscle.max_isometric_force for muscle in model.muscles]
    return np.stack((forces.active / strength, forces.passive / strength, forces.cos_pennation), axis=-1)


def rigid_factors(muscle: Any, state: Any, _model: Model) -> list[float]:
    """The same of OpenSim, from its multipliers."""
    cosine = muscle.getCosPennationAngle(state)
    active = muscle.getActiveForceLengthMultiplier(state) * muscle.getForceVelocityMultiplier(state)
    return [active * cosine, muscle.getPassiveForceMultiplier(state) * cosine, cosine]


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
        span(model, made(kind, name, **RIGID | {"set_ignore_activation_dynamics": is_ignored}))
    ours = read_back(model, tmp_path)
    again = written(ours, tmp_path / "written.osim")
    for file, read in ((tmp_path / "two_bodies.osim", ours), (again, read_osim(again))):
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


@pytest.mark.parametrize(
    ("kind", "tag"),
    [
        *((kind, "pennation_angle_at_optimal") for kind in KINDS),
        *((kind, "maximum_pennation_angle") for kind in KINDS[:2]),
    ],
)
def test_a_pennation_is_refused_where_opensim_refuses_it(kind: str, tag: str, tmp_path: Path) -> None:
    model = model_with(opensim.UniversalJoint)
    span(model, made(kind, "calf"))
    file = printed(model, tmp_path / "calf.osim")
    before, after = file.read_text().split(f'<{kind} name="calf">')
    for angle in (-0.1, 0.0, 1.5, RIGHT_ANGLE - 1e-12, RIGHT_ANGLE, 1.571, 3.2):
        file.write_text(f'{before}<{kind} name="calf"><{tag}>{angle!r}</{tag}>{after}')
        try:
            opensim.Model(str(file)).initSystem()
        except RuntimeError as refusal:
            assert tag in str(refusal)
            with raises_refusal(SolverCode.WRONG_PENNATION, naming="calf"):
                read_osim(file)
        else:
            assert read_osim(file).muscles[-1].name == "calf"


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


def muscle_of(kind: str, fiber: tuple[float, float, float], **settings: Any) -> Any:
    has_dynamics = kind == "Thelen2003Muscle"  # always
    settings = {"set_ignore_activation_dynamics": not has_dynamics, **fiber_settings(*fiber, STRENGTH), **settings}
    return made(kind, "muscle", **settings)


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
    for name, frame in (("start", model.getGround()), ("end", block)):
        path_of(muscle).appendNewPathPoint(name, frame, vec3(0, 0, 0))
    control = opensim.Sine(course.swing, course.frequency, 1.0, course.mean)
    controller = made("PrescribedController", "control", addActuator=muscle)
    controller.prescribeControlForActuator("muscle", given(control))
    model.addController(given(controller))
    model.finalizeConnections()
    return model


def read_slide(model: Any, folder: Path) -> Model:
    file = printed(model, folder / "slide.osim", ("<prescribed>true", "<prescribed>false"))
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


@pytest.mark.parametrize("fiber", ["short tendon", pytest.param("long tendon", marks=pytest.mark.slow)])
@pytest.mark.parametrize("kind", KINDS)
def test_forces_are_those_of_a_forward_simulation(kind: str, fiber: str, tmp_path: Path) -> None:
    """The error falls with the square of the interval; extrapolated to an interval of zero, hardly any remains."""
    optimal, slack, _ = TENDON_FIBERS[fiber]
    course = Course(slack + 0.95 * optimal, 0.2 * optimal, 2 * np.pi / DURATION)
    model = model_of(muscle_of(kind, TENDON_FIBERS[fiber]), course)
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


@pytest.mark.parametrize("fiber", TENDON_FIBERS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_muscle_at_rest_is_in_the_equilibrium_of_opensim(kind: str, fiber: str, tmp_path: Path) -> None:
    """To the tolerance of OpenSim's search."""
    optimal, slack, _ = TENDON_FIBERS[fiber]
    for length in (0.7, 0.95, 1.15, 1.4):
        course = Course(slack + length * optimal, 0.0, 1.0)
        model = model_of(muscle_of(kind, TENDON_FIBERS[fiber]), course)
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
    curve = opensim.TendonForceLengthCurve(*figures)
    muscle = muscle_of(KINDS[0], TENDON_FIBERS["long tendon"], setTendonForceLengthCurve=curve)
    tendon = read_slide(model_of(muscle, Course(0.3, 0.0, 1.0)), tmp_path).muscles[0].tendon
    assert isinstance(tendon, MillardTendon)
    lengths = np.linspace(0.98, 1.1, 241)
    np.testing.assert_allclose(tendon.force(lengths), [curve.calcValue(x) for x in lengths], rtol=0, atol=1e-12)


def test_a_tendon_curve_of_de_groote_and_fregly(tmp_path: Path) -> None:
    muscle = muscle_of(KINDS[2], TENDON_FIBERS["long tendon"], set_tendon_strain_at_one_norm_force=0.07)
    model = model_of(muscle, Course(0.3, 0.0, 1.0))  # kept, because it owns the muscle
    tendon = read_slide(model, tmp_path).muscles[0].tendon
    assert isinstance(tendon, DeGrooteFreglyTendon)
    lengths = np.linspace(0.98, 1.1, 25)
    expected = [muscle.calcTendonForceMultiplier(x) for x in lengths]
    np.testing.assert_allclose(tendon.force(lengths), expected, rtol=1e-12, atol=1e-13)


def test_a_tendon_curve_of_thelen(tmp_path: Path) -> None:
    """Seen as the tendon's force at given fibre lengths."""
    optimal, slack, _ = fiber = 0.1, 0.3, 0.0
    model = model_of(muscle_of(KINDS[1], fiber, set_FmaxTendonStrain=0.05), Course(slack + optimal, 0.0, 1.0))
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
    muscle = muscle_of(kind, TENDON_FIBERS["long tendon"], set_ignore_tendon_compliance=True)
    ours = read_slide(model_of(muscle, Course(0.35, 0.0, 1.0)), tmp_path)
    assert ours.muscles[0].tendon is None
    with raises_refusal(SolverCode.NO_TENDON, naming="slide"):
        elastic_forces(ours, *np.full((3, 1, 1), 0.3), 0.01)


def test_a_fibre_at_its_least_length_is_held_as_in_opensim(tmp_path: Path) -> None:
    optimal, slack, _ = TENDON_FIBERS["short tendon"]
    course = Course(slack + 0.55 * optimal, 0.25 * optimal, 2 * np.pi / DURATION, 0.5, 0.0)
    # with damping a fibre that gives no force gets there in seconds
    model = model_of(muscle_of(KINDS[0], TENDON_FIBERS["short tendon"], set_fiber_damping=0.0), course)
    expected = simulate(model, np.linspace(0.0, DURATION, 401))
    found = expected.ours(read_slide(model, tmp_path), course, 1)
    held = found.is_shortest[:, 0]
    assert 20 < held.sum() < 300
    np.testing.assert_allclose(found.fiber_lengths[held, 0], 0.4441 * optimal, rtol=1e-12)
    np.testing.assert_allclose(expected.fiber[held], 0.4441 * optimal, rtol=2e-2)
    np.testing.assert_allclose(found.tension[:, 0], expected.force, atol=5e-3 * STRENGTH)
