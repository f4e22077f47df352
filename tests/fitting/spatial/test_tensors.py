"""Pulls in several directions: K and C in space with errors that hold, and nothing where directions are missing."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from fitting.cuffs.cuffs_file import cuffs_json
from fitting.pull.pull import Pull, make_pulls
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TensorCode, TrialNoteCode
from fitting.session import fit_session
from fitting.spatial.tensors import NoTensor, Tensor, held_tensor, require_span, swung_tensor, tensor_entries
from tests.fitting.pulled_in_space import Space, directions, elbow, pulled
from tests.refusals import figures_by_code, raises_refusal

RUNS = 12


def _reduced(space: Space, pulls: NDArray[np.float64], random: np.random.Generator) -> list[Pull]:
    trials = [pulled(space, u, test, i, random) for i, u in enumerate(pulls, 1) for test in ("static", "dynamic")]
    return make_pulls(trials)[0]


def _of(trials: list[Pull], test: str) -> list[Pull]:
    return [each for each in trials if each.trial.test == test]


@cache
def fitted_run(seed: int, rope_error: float = 0.0) -> tuple[Space, Tensor, Tensor]:
    """K and C of a cuff turned at random; sway, lag and noise drawn anew."""
    random = np.random.default_rng(seed)
    space = replace(elbow(random), rope_error=rope_error, lag=0.2e-3 * random.standard_normal(), lag_sd=0.2e-3)
    trials = _reduced(space, directions(30), random)
    return space, held_tensor(_of(trials, "static"), 0.0), swung_tensor(_of(trials, "dynamic"), {}, 0.0)


def fitted(runs: int = RUNS, rope_error: float = 0.0) -> list[tuple[Space, Tensor, Tensor]]:
    return [fitted_run(seed, rope_error) for seed in range(runs)]


def _covered(found: list[tuple[Space, Tensor, Tensor]], part: float = 1.0) -> tuple[float, float]:
    """Part of the entries of K and of C that lie in their intervals, those made narrower."""
    stiffness = [_inside(tensor, space.stiffness, part) for space, tensor, _ in found]
    damping = [_inside(tensor, space.damping, part) for space, _, tensor in found]
    return float(np.mean(stiffness)), float(np.mean(damping))


def _inside(tensor: Tensor, true: NDArray[np.float64], part: float) -> NDArray[np.bool_]:
    return np.abs(tensor_entries(tensor.value - true)) < part * tensor.factor * tensor_entries(tensor.standard_error)


@pytest.mark.slow
def test_intervals_of_entries_hold_with_every_run_drawn_anew() -> None:
    stiffness, damping = _covered(fitted())
    assert stiffness >= 0.85
    assert damping >= 0.85


@pytest.mark.slow
def test_halved_intervals_or_a_displaced_rope_would_have_too_little_coverage() -> None:
    assert max(_covered(fitted(), part=0.5)) < 0.85
    assert max(_covered(fitted(4, rope_error=0.03))) < 0.85


@pytest.mark.parametrize("runs", [1, pytest.param(RUNS, marks=pytest.mark.slow)])
def test_entries_are_near_the_truth(runs: int) -> None:
    for space, stiffness, damping in fitted(runs):
        largest = np.abs(space.stiffness).max()
        assert np.abs(np.diag(stiffness.value) / np.diag(space.stiffness) - 1).max() < 0.03
        assert np.abs(stiffness.value - space.stiffness).max() < 0.05 * largest
        assert np.abs(damping.value - space.damping).max() < 0.1 * np.abs(space.damping).max()


@pytest.mark.slow
def test_eigenvalues_and_axes_lie_in_their_intervals() -> None:
    inside, cones = [], []
    for space, stiffness, _ in fitted():
        values, axes = np.linalg.eigh(space.stiffness)
        inside += [
            each.ci95[0] < value < each.ci95[1] for each, value in zip(stiffness.eigenvalues, values, strict=True)
        ]
        angles = np.arccos(np.minimum(1.0, np.abs(np.sum(stiffness.axes * axes.T, axis=1))))
        cones += (angles < stiffness.axis_ci95).tolist()
    assert np.mean(inside) >= 0.85
    assert np.mean(cones) >= 0.85
    assert all(max(stiffness.axis_ci95) < 0.02 for _, stiffness, _ in fitted())


def test_an_axis_between_equal_eigenvalues_is_not_determined_and_a_missing_direction_is_named() -> None:
    tensor = Tensor(np.diag([1000.0, 1000.0 + 1e-6, 3000.0]), np.eye(6), 1.96, 5)
    assert tensor.axis_ci95[0] == pytest.approx(np.pi / 2)
    assert tensor.axis_ci95[2] < 0.01
    assert tensor.eigenvalues[2].standard_error == pytest.approx(1.0)
    with pytest.raises(NoTensor) as caught:
        require_span(directions(30)[[0, 1, 3]], "stiffness", "static")
    named = np.array([float(part) for part in str(caught.value.reason.figures["missing"]).strip("()").split(", ")])
    assert abs(named @ (0.0, 0.0, 1.0)) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize(
    ("pulls", "code", "count"),
    [
        (directions(30, 1), TensorCode.ONE_LINE, 1),
        (directions(4), TensorCode.ONE_LINE, 1),
        (directions(30)[[0, 1, 3]], TensorCode.ONE_PLANE, 3),
    ],
)
def test_directions_that_do_not_span_space_are_refused(
    pulls: NDArray[np.float64], code: TensorCode, count: int
) -> None:
    with raises_refusal(code, quantity="stiffness", test="static", directions=count):
        require_span(pulls, "stiffness", "static")


def test_the_frame_of_the_room_turns_the_tensor_and_nothing_else() -> None:
    random = np.random.default_rng(5)
    space = elbow(random)
    trials = [pulled(space, u, "static", i, random) for i, u in enumerate(directions(30), 1)]
    turn = np.linalg.qr(random.standard_normal((3, 3)))[0]
    turn *= np.linalg.det(turn)
    straight = held_tensor(make_pulls(trials)[0], 0.0)
    turned = held_tensor(make_pulls([replace(each, markers=each.markers @ turn.T) for each in trials])[0], 0.0)
    np.testing.assert_allclose(turned.value, turn @ straight.value @ turn.T, rtol=1e-6, atol=1e-3)


def test_a_donning_pulled_in_five_directions_keeps_one_line_and_adds_space() -> None:
    random = np.random.default_rng(1)
    space = elbow(random)
    pulls = directions(30)
    trials = [pulled(space, u, test, i, random) for i, u in enumerate(pulls, 1) for test in ("static", "dynamic")]
    session = fit_session(trials)
    fit = session.cuffs["elbow"]
    assert fit.stiffness
    assert fit.tensors.stiffness
    assert fit.tensors.damping
    along = 1 / (pulls[0] @ np.linalg.inv(space.stiffness) @ pulls[0])
    assert fit.stiffness.value == pytest.approx(along, rel=0.01)
    notes = {trial.file: figures_by_code(trial.notes) for trial in fit.trials}
    assert notes["static-2"][TrialNoteCode.ANOTHER_LINE]["angle_deg"] == pytest.approx(30.0, abs=1.0)
    assert TrialNoteCode.ANOTHER_LINE not in notes["static-1"]
    assert len(fit.sources) == 10
    plain = json.loads(cuffs_json(session))["cuffs"]["elbow"]
    assert len(plain["stiffness_tensor_n_per_m"]["eigenvalues"]) == 3
    assert plain["damping_tensor_n_s_per_m"]["directions"] == 5
    for tensor, causes in ((fit.tensors.stiffness, ("gain",)), (fit.tensors.damping, ("lag", "gain"))):
        assert tuple(tensor.parts) == ("noise", *causes, "posture")
        np.testing.assert_allclose(sum(tensor.parts.values()), tensor.covariance)
    (low, high), value = plain["stiffness_tensor_n_per_m"]["ci95"], plain["stiffness_tensor_n_per_m"]["value"]
    assert np.all(np.array(low) < value)
    assert np.all(np.array(high) > value)
    of_lag = plain["damping_tensor_n_s_per_m"]["parts"]["lag"]
    np.testing.assert_allclose(of_lag, space.lag_sd * np.abs(value), rtol=0.05, atol=0.05)


def test_every_direction_has_repeats_of_its_own() -> None:
    random = np.random.default_rng(6)
    space = replace(elbow(random), loads=(15.0, 30.0, 45.0))
    trials = []
    for run, u in enumerate((*directions(40, 3), directions(40, 3)[2]), 1):  # the third pull is recorded twice
        trial = pulled(space, u, "static", run, random)
        trials.append(replace(trial, repeat=1, run=run, start_utc_ns=run))
    fit = fit_session(trials).cuffs["elbow"]
    assert [trial.state for trial in fit.trials] == ["used", "used", "superseded", "used"]
    assert fit.trials[2].reason == Note(RejectionCode.RECORDED_AGAIN, {"file": "static-4"})
    assert fit.tensors.stiffness.directions == 3


def test_without_rope_markers_trials_in_another_direction_are_reported() -> None:
    random = np.random.default_rng(3)
    space = elbow(random)
    trials = []
    for i, u in enumerate(directions(40, 2), 1):
        trial = pulled(space, u, "static", i, random)
        trials.append(replace(trial, cuff=replace(trial.cuff, rope_markers=())))
    first, second = make_pulls(trials)[0]
    assert TrialNoteCode.TURNED not in figures_by_code(first.notes)
    assert TrialNoteCode.TURNED in figures_by_code(second.notes)
    assert not second.is_along_another_line


def test_swings_that_all_go_another_way_are_a_fault_to_name_and_no_set_of_directions() -> None:
    random = np.random.default_rng(4)
    space = elbow(random)
    ahead, aside = directions(40, 2)
    trials = [pulled(space, ahead, "static", 1, random), pulled(space, aside, "dynamic", 1, random)]
    assert not any(each.is_along_another_line for each in make_pulls(trials)[0])


def test_swings_count_along_the_rope_that_pulls_them() -> None:
    random = np.random.default_rng(5)
    space = Space(2530.0 * np.eye(3), 139.0 * np.eye(3))  # alike in all directions, so along every rope
    ahead, aside = directions(40, 2)
    fit = fit_session([pulled(space, ahead, "static", 1, random), pulled(space, aside, "dynamic", 1, random)])
    elbow_fit = fit.cuffs["elbow"]
    assert elbow_fit.diagnostics["dynamic_stiffness_n_per_m"] == pytest.approx(2530, rel=0.01)
    assert abs(elbow_fit.damping.value - 139.0) < 3 * elbow_fit.damping.standard_error < 15.0


def test_one_direction_gives_its_line_and_says_why_no_tensor() -> None:
    random = np.random.default_rng(2)
    space = elbow(random)
    fit = fit_session([pulled(space, directions(30)[0], "static", 1, random)]).cuffs["elbow"]
    assert fit.stiffness
    assert fit.tensors.stiffness is None
    assert fit.tensors.no_stiffness and fit.tensors.no_stiffness.code is TensorCode.ONE_LINE
    assert fit.tensors.no_damping and fit.tensors.no_damping.code is TensorCode.NO_ROPE
