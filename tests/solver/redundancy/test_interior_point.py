"""The compiled solver on seeded random problems: against Clarabel, at bounds, on the cone, and beyond it."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from solver.redundancy.problem import CONE_FORCE_SCALE, FrameOutcome, RedundancyProblem
from solver.redundancy.reduction import reduce_frames
from solver.redundancy.sequence import solve_sequence, solve_sequence_with_clarabel

SEEDS = range(12)


def silent(done, total):
    """No observer."""


def random_sequence(seed, frames=4, scenarios=2, reach=0.3, cone=3):
    """10 muscles, 3 reserves and 2 free actuators under 5 accelerations that a constraint leaves a rank of 4; with a
    reach near 1 many muscles are at a bound, and the cone is turned so that it matters in most frames.
    """
    generator = np.random.default_rng(seed)
    basis = np.linalg.qr(generator.normal(size=(5, 4)))[0]
    start, drift = generator.normal(size=(2, 4, 15))
    matrix = np.stack([basis @ (start + 0.05 * i * drift) for i in range(frames)])
    wanted = reach * generator.uniform(size=(scenarios, 1, 15)) * (generator.uniform(size=(scenarios, 1, 15)) < 0.5)
    wanted = wanted * np.linspace(1, 1.2, frames)[:, None]
    target = np.einsum("fij,sfj->sfi", matrix, wanted)
    reaction, at_rest = np.zeros((frames, 6, 15)), np.zeros((scenarios, frames, 6))
    if cone:
        reaction[:, 3:] = generator.normal(size=(cone, 15))
        reaction[:, 3] *= 0.3
        ray = np.einsum("fij,sfj->sfi", reaction[:, 3:], wanted)
        at_rest[..., 3] = np.hypot(ray[..., 1], ray[..., 2]) - ray[..., 0] + 0.02
    return RedundancyProblem(
        time=np.arange(float(frames)),
        interval=1.0,
        weights=np.array([1.0] * 10 + [10.0] * 3 + [0.0] * 2),
        time_constants=np.full((2, 10), 0.2),
        matrix=matrix,
        target=target,
        tracked=np.ones(5, bool),
        reaction_matrix=reaction,
        reaction_at_rest=at_rest,
        cone=np.tile(CONE_FORCE_SCALE * np.eye(cone, 3), (frames, 1, 1)),
    )


def violation(sequence, controls):
    """Largest one of a bound, of the cone, and of the equalities, which all can be met here."""
    muscles = controls[..., : sequence.muscles]
    gaps = [np.abs(np.einsum("fij,sfj->sfi", sequence.matrix, controls) - sequence.target).max(), -muscles.min()]
    gaps.append(muscles.max() - 1)
    if sequence.cone_matrix.shape[1]:
        ray = np.einsum("fij,sfj->sfi", sequence.cone_matrix, controls) + sequence.cone_offset
        gaps.append((np.hypot(ray[..., 1], ray[..., 2]) - ray[..., 0]).max())
    return max(gaps)


def by_both(sequence):
    """Controls and outcomes of the compiled solver, and of Clarabel."""
    return (solve(sequence, silent) for solve in (solve_sequence, solve_sequence_with_clarabel))


@pytest.mark.parametrize("cone", [3, 0])
@pytest.mark.parametrize("reach", [0.3, 1.0])
@pytest.mark.parametrize(("exponent", "seed"), [*((2, seed) for seed in SEEDS), *((3, seed) for seed in range(6))])
def test_effort_is_that_of_clarabel_and_rows_are_met(exponent, seed, reach, cone):
    sequence = replace(random_sequence(seed, reach=reach, cone=cone), exponent=exponent)
    (controls, outcomes), (reference, known) = by_both(sequence)
    assert (outcomes == FrameOutcome.SOLVED).all()
    is_known = known == FrameOutcome.SOLVED
    assert is_known.all() if exponent == 2 else is_known.mean() > 0.8  # cubes are hard for Clarabel
    powers = np.array([exponent] * 10 + [2] * 5)
    effort, expected = ((sequence.weights * x**powers).sum(axis=-1)[is_known] for x in (controls, reference))
    rtol, atol = {2: (1e-6, 1e-7), 3: (1e-4, 1e-6)}[exponent]
    np.testing.assert_allclose(effort, expected, rtol=rtol, atol=atol)
    assert violation(sequence, controls) < 1e-8


def test_bounds_and_cone_are_active_in_these_problems():
    touching, at_bound = [], []
    for seed in SEEDS:
        sequence = random_sequence(seed, reach=1.0)
        controls, _ = solve_sequence(sequence, silent)
        ray = np.einsum("fij,sfj->sfi", sequence.cone_matrix, controls) + sequence.cone_offset
        touching.append(ray[..., 0] - np.hypot(ray[..., 1], ray[..., 2]) < 1e-9)
        at_bound.append((controls[..., :10] == 0) | (controls[..., :10] == 1))
    assert 0.2 < np.mean(touching) < 1
    assert 0.1 < np.mean(at_bound) < 0.9


@pytest.mark.parametrize("distance", [50.0, 5e6])
@pytest.mark.parametrize("seed", SEEDS)
def test_a_cone_out_of_reach_is_infeasible_and_missed_by_as_little_as_can_be(seed, distance):
    sequence = random_sequence(seed)
    lifted = sequence.reaction_at_rest.copy()
    lifted[0, 1, 3] -= distance  # more than muscles between their bounds can make good
    sequence = replace(sequence, reaction_at_rest=lifted, weights=np.array([1.0] * 15))
    sequence = replace(sequence, reaction_matrix=np.where(np.arange(15) < 10, sequence.reaction_matrix, 0))
    (controls, outcomes), (reference, known) = by_both(sequence)
    np.testing.assert_array_equal(outcomes, known)
    assert outcomes[0, 1] is FrameOutcome.INFEASIBLE
    assert (np.delete(outcomes.ravel(), 1) == FrameOutcome.SOLVED).all()

    def missed(x):
        ray = sequence.cone_matrix[1] @ x[0, 1] + sequence.cone_offset[0, 1]
        return np.hypot(ray[1], ray[2]) - ray[0]

    assert missed(controls) > 1
    assert missed(controls) == pytest.approx(missed(reference), abs=max(1e-4, 1e-8 * distance))
    error = np.abs(sequence.matrix[1] @ controls[0, 1] - sequence.target[0, 1]).max()
    assert error < max(1e-4, 1e-7 * distance)


def test_a_structure_that_cannot_be_reduced_is_solved_all_the_same():
    # a muscle without weight leaves its activation to the others
    sequence = random_sequence(1)
    weights = sequence.weights.copy()
    weights[4] = 0.0
    assert reduce_frames(replace(sequence, weights=weights)) is None
    controls, outcomes = solve_sequence(replace(sequence, weights=weights), silent)
    assert (outcomes == FrameOutcome.SOLVED).all()
    assert violation(sequence, controls) < 1e-6


def test_undetermined_actuators_without_weight_are_not_reduced():
    sequence = random_sequence(1)
    twin = sequence.matrix.copy()
    twin[..., 14] = twin[..., 13]
    assert reduce_frames(replace(sequence, matrix=twin)) is None
    assert reduce_frames(sequence) is not None


@pytest.mark.parametrize("scale", [1e4, 3e4, 1e6])
@pytest.mark.parametrize("seed", range(6))
def test_an_outcome_does_not_depend_on_the_frame_before(seed, scale):
    """Targets that only controls of thousands reach: solved or infeasible by the limit of the effort alone."""
    sequence = random_sequence(seed, frames=6, cone=0)
    sequence = replace(sequence, target=scale * sequence.target, weights=np.array([1.0] * 10 + [10.0] * 5))
    together = solve_sequence(sequence, silent)[1]
    alone = [solve_sequence(sequence.cut(slice(i, i + 1)), silent)[1][:, 0] for i in range(6)]
    np.testing.assert_array_equal(together, np.stack(alone, axis=1))


def test_progress_counts_frames_to_the_last():
    seen = []
    solve_sequence(random_sequence(0, frames=230), lambda done, total: seen.append((done, total)))
    assert seen[-1] == (230, 230)
    assert seen == sorted(seen)


@pytest.mark.parametrize("seed", SEEDS)
def test_limited_actuators_and_activations_are_solved_as_by_clarabel(seed):
    sequence = random_sequence(seed, reach=0.6)
    free = solve_sequence(sequence, silent)[0][..., 10:12]
    least, greatest = free.min(axis=(0, 1)), free.max(axis=(0, 1))
    inner = np.full((2, 5), [[-np.inf], [np.inf]])
    inner[:, :2] = least - 0.1 * (greatest - least), greatest - 0.1 * (greatest - least)
    activations = np.repeat([[0.01], [0.8]], 10, axis=1)
    limited = replace(sequence, control_limits=inner, activation_limits=activations)
    (ours, outcomes), (theirs, expected) = by_both(limited)
    np.testing.assert_array_equal(outcomes, expected)
    is_solved = outcomes == FrameOutcome.SOLVED
    np.testing.assert_allclose(ours[is_solved], theirs[is_solved], atol=1e-4)
    assert ours[is_solved][:, :10].min(initial=1.0) >= 0.01 - 1e-12
    assert (ours[is_solved][:, 10:12] <= inner[1, :2] + 1e-9).all()


@pytest.mark.parametrize("scale", [10.0, 1e2, 1e3, 1e6])
def test_frames_are_infeasible_where_linear_programming_finds_no_point(scale):
    """HiGHS, which looks for any point: no actuator moves the first row, the others give what is missing.

    Far beyond the muscles the method stops before its multipliers are a certificate; Clarabel's are one.
    """
    sequence = random_sequence(3, frames=30, cone=0)
    matrix = sequence.matrix.copy()
    matrix[:, 0, 10:] = 0.0
    far = replace(sequence, matrix=matrix, target=scale * sequence.target)
    outcomes = solve_sequence(far, silent)[1]
    bounds = [(0, 1)] * 10 + [(None, None)] * 5
    for scenario, frame in np.ndindex(outcomes.shape):
        left, sizes, right = np.linalg.svd(matrix[frame])
        rank = int((sizes > 1e-9 * sizes[0]).sum())
        target = left[:, :rank].T @ far.target[scenario, frame] / sizes[:rank]
        is_feasible = linprog(np.zeros(15), A_eq=right[:rank], b_eq=target, bounds=bounds).status == 0
        assert outcomes[scenario, frame] == (FrameOutcome.SOLVED if is_feasible else FrameOutcome.INFEASIBLE)
    if scale >= 1e3:
        assert (outcomes == FrameOutcome.INFEASIBLE).all()
        assert (solve_sequence_with_clarabel(far, silent)[1] == FrameOutcome.INFEASIBLE).all()


def test_without_activation_dynamics_every_frame_is_solved_by_itself():
    sequence = random_sequence(3, frames=6)
    last = solve_sequence(sequence.cut(slice(5, 6)), silent)[0][:, 0]  # with them, but their bounds do not bind
    np.testing.assert_allclose(last, solve_sequence(sequence, silent)[0][:, -1], atol=1e-9)
    still = replace(sequence, has_activation_dynamics=False)
    together = solve_sequence(still, silent)[0]
    alone = [solve_sequence(still.cut(slice(i, i + 1)), silent)[0][:, 0] for i in range(6)]
    np.testing.assert_allclose(together, np.stack(alone, axis=1), atol=1e-9)
    with_clarabel = solve_sequence_with_clarabel(still, silent)[0]
    np.testing.assert_allclose(together, with_clarabel, atol=1e-4)
