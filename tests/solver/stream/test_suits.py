"""Suits of the stream beside the offline assessment of the same motion, and models that lack something."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from solver.errors import SolverError
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import Model
from solver.motion import Kinematics
from solver.redundancy.glenoid import CENTER_MARKER, EDGE_MARKER, HEAD_MARKER, JOINT
from solver.redundancy.options import RedundancyOptions
from solver.stream.frame_muscles import FrameMuscles
from solver.stream.stream_frame import StreamNotice, StreamSuitOutcome
from solver.stream.stream_scenario import StreamScenario
from solver.stream.stream_solver import StreamSolver
from solver.suit.scenarios import LoadedMotion, SuitScenario, prepare_suited_motion, solve_scenarios, solve_without_suit
from solver.suit.suit import Rate, SuitError
from tests.solver.stream.streams import (
    ARM,
    FIRST,
    INTERVAL,
    MODEL,
    SUIT,
    TASKS,
    WAIST,
    WORN,
    raised,
    seen,
    solver,
    stream,
)

FRAMES = 30
SHORTER = 0.9 * SUIT.reference_rest_length


def motion() -> Kinematics:
    positions = raised()[FIRST - 3 : FIRST + FRAMES + 3]
    speeds = np.gradient(positions, INTERVAL, axis=0)
    accelerations = np.gradient(speeds, INTERVAL, axis=0)
    time = INTERVAL * np.arange(FRAMES)
    return Kinematics(time, INTERVAL, positions[3:-3], speeds[3:-3], accelerations[3:-3], None)


@pytest.mark.parametrize("rate", ["backward", "central"])
def test_cord_and_muscles_are_those_of_the_offline_assessment(rate: Rate) -> None:
    suit, kinematics = replace(SUIT, rate=rate), motion()
    worn = {"bare": None, "slack": StreamScenario(), "worn": WORN, "rigid": StreamScenario(SHORTER)}
    live = FrameMuscles(MODEL, worn, suit, RedundancyOptions())
    frames = [
        live.solve(time, np.stack(state), INTERVAL)
        for time, *state in zip(
            kinematics.time, kinematics.positions, kinematics.speeds, kinematics.accelerations, strict=True
        )
    ]
    suited = prepare_suited_motion(LoadedMotion(MODEL, kinematics), suit)
    both = SuitScenario("both", WAIST, ARM, np.array([WORN.rest_length]))
    rigid = SuitScenario("rigid", None, None, np.array([SHORTER]))
    slack, offline = solve_scenarios(suited, [both, rigid])
    expected = {"slack": slack, "worn": offline[0], "rigid": offline[1], "bare": solve_without_suit(suited, slack)}
    inner = range(2, FRAMES - 2)  # differences at the ends have one neighbour
    for name, scenario in expected.items():
        found = np.array([frame[name].activations for frame in frames])
        np.testing.assert_allclose(found[inner], scenario.activations[0, inner], rtol=0, atol=2e-4)
    for name, cuffs in (("worn", both), ("rigid", rigid)):
        tension = np.array([frame[name].cord_force_n for frame in frames])
        np.testing.assert_allclose(tension[inner], suited.forces(cuffs).tension[0, inner], rtol=0, atol=0.02)
        assert tension.max() > 1.0
    assert all(frame["slack"].cord_force_n == 0.0 for frame in frames)


def test_a_rest_length_acts_from_the_next_frame_on() -> None:
    live, forces = solver({"worn": StreamScenario(SHORTER)}, lag_s=0.0), []
    for k, positions in enumerate(seen()[:20]):
        (frame,) = live.push(k * INTERVAL, positions)
        forces.append(frame.suits["worn"].cord_force_n)
        if k == 9:
            live.set_rest_length("worn", SHORTER - 0.05)
    stretched = 0.05 * SUIT.stiffness
    assert forces[10] - forces[9] == pytest.approx(stretched, rel=0.05)
    with pytest.raises(SuitError):
        live.set_rest_length("unknown", 0.7)
    with pytest.raises(SuitError):
        live.set_rest_length("worn", 0.0)


def test_a_cuff_without_equilibrium_is_an_outcome_of_its_scenario_only() -> None:
    soft = replace(WORN, rest_length=0.05, arm=replace(ARM, stiffness=1.0))
    frames = stream(seen()[:5], solver({"soft": soft, "slack": StreamScenario(), "worn": WORN}))
    for frame in frames:
        assert frame.suits["soft"].outcome is StreamSuitOutcome.CUFF_NOT_AT_REST
        assert not frame.suits["soft"].is_solved
        assert frame.suits["worn"].is_solved
        assert frame.suits["slack"].is_solved


def test_skipped_muscles_leave_kinematics_as_they_are() -> None:
    all_frames, thinned = stream(seen()[:20]), []
    live = solver()
    for k, positions in enumerate(seen()[:20]):
        thinned += live.push(k * INTERVAL, positions, solve_muscles=k % 3 == 0)
    thinned += live.finish(solve_muscles=False)
    for one, other in zip(all_frames, thinned, strict=True):
        assert one.coordinates.tobytes() == other.coordinates.tobytes()
        assert set(other.suits) <= {"bare"}
    assert 0 < sum(bool(frame.suits) for frame in thinned) < 10


def without_glenoid(model: Model) -> Model:
    markers = [m for m in model.markers if m.name not in (CENTER_MARKER, EDGE_MARKER, HEAD_MARKER)]
    return replace(model, markers=tuple(markers))


def test_a_model_without_a_glenoid_is_solved_without_its_cone_with_a_finding() -> None:
    model = without_glenoid(MODEL)
    live = StreamSolver(model, TASKS, {"bare": None})
    assert live.notices == {StreamNotice.NO_GLENOID_CONE}
    frames = stream(seen()[:4], live)
    assert all(frame.suits["bare"].is_solved for frame in frames)
    assert all(np.isfinite(frame.suits["bare"].glenohumeral_force_n).all() for frame in frames)
    assert all(np.isnan(frame.suits["bare"].glenohumeral_force_in_glenoid_n).all() for frame in frames)


def test_a_model_without_that_joint_has_muscles_and_no_joint_force() -> None:
    joints = tuple(replace(joint, name="shoulder") if joint.name == JOINT else joint for joint in MODEL.joints)
    live = StreamSolver(replace(without_glenoid(MODEL), joints=joints), TASKS, {"bare": None})
    assert live.notices == {StreamNotice.NO_GLENOID_CONE, StreamNotice.NO_GLENOHUMERAL_JOINT}
    (*_, frame) = stream(seen()[:4], live)
    assert frame.suits["bare"].is_solved
    assert np.isnan(frame.suits["bare"].glenohumeral_force_n).all()


def test_wrong_calls_are_refused() -> None:
    with pytest.raises(SuitError):
        StreamSolver(MODEL, TASKS, {"worn": WORN})
    with pytest.raises(SolverError):
        solver(lag_s=1.0)
    with pytest.raises(SolverError):
        StreamSolver(MODEL, TrackingTasks(TASKS.markers, TASKS.weights[:-1]), {})
    for wrong in (
        {"glenoid_aspect": 0.0},
        {"free_coordinates": ("nose",)},
        {"weights": {"nose": 1.0}},
        {"tendons": "elastic"},
    ):
        with pytest.raises(SolverError):
            solver(options=RedundancyOptions(**wrong))
    with pytest.raises(SolverError):
        StreamSolver(replace(MODEL, muscles=()), TASKS, {"bare": None})
