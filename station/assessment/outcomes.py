"""The solver's outcome codes as sentences."""

from __future__ import annotations

import numpy as np

from solver.muscle import MuscleOutcome
from solver.redundancy.motion import FrameOutcome, MotionSolution

IN_THE_GLENOID = " and keep the joint reaction inside the glenoid"
"""Further part of the sentence of an infeasible frame, with the glenoid constraint."""

FRAME_SENTENCES = {
    FrameOutcome.BEYOND_ACTIVATION_RATE: (
        "the muscles cannot change their activation fast enough since the last frame; solved without that limit"
    ),
    FrameOutcome.INFEASIBLE: (
        "no activations between 0 and 1 and controls within their limits give the accelerations" + IN_THE_GLENOID
    ),
    FrameOutcome.NOT_CONVERGED: "the solver stopped before its residuals were small; its last point is given",
    FrameOutcome.NOT_FINITE: "the model has no finite accelerations in this posture; the frame is left out",
}
MUSCLE_SENTENCES = {
    MuscleOutcome.PATH_NOT_CONVERGED: (
        "the path reached the limit of iterations, as in OpenSim, and its last point is used; compare with geodesics"
    ),
    MuscleOutcome.CURVE_NOT_CONVERGED: "the force did not converge on the curve of the fibre; its last point is used",
}
UNSOLVED, UNCONVERGED = tuple(FRAME_SENTENCES), tuple(MUSCLE_SENTENCES)


def describe_unsolved(solution: MotionSolution) -> list[str]:
    """A sentence for each outcome of frames that are not solved; of infeasible ones, with the smallest violation."""
    sentences = []
    for outcome in UNSOLVED:
        frames = [index for index, found in enumerate(solution.outcomes) if found is outcome]
        if not frames:
            continue
        has_glenoid = bool(np.isfinite(solution.cone_slack[frames]).any())  # infinite where it was not asked for
        meaning = FRAME_SENTENCES[outcome] if has_glenoid else FRAME_SENTENCES[outcome].replace(IN_THE_GLENOID, "")
        if outcome is FrameOutcome.INFEASIBLE:
            meaning += _violation(solution, frames, has_glenoid=has_glenoid)
        sentences.append(f"{_count(solution, frames)}: {meaning}")
    return sentences


def describe_unconverged(solution: MotionSolution) -> list[str]:
    """A sentence for each outcome of muscles that did not converge, with their names."""
    sentences = []
    for outcome in UNCONVERGED:
        frames = np.flatnonzero(solution.frames_with(outcome)).tolist()
        if frames:
            names = ", ".join(muscles_with(solution, outcome))
            sentences.append(f"{_count(solution, frames)}, {names}: {MUSCLE_SENTENCES[outcome]} ({outcome})")
    return sentences


def note_unconverged(solution: MotionSolution) -> str:
    """For a table: each code with its number of frames and its muscles; "converged" where there is none."""
    notes = [
        f"{outcome} in {int(solution.frames_with(outcome).sum())} frames of {' '.join(muscles_with(solution, outcome))}"
        for outcome in UNCONVERGED
        if solution.frames_with(outcome).any()
    ]
    return "; ".join(notes) or MuscleOutcome.CONVERGED


def muscles_with(solution: MotionSolution, outcome: MuscleOutcome) -> list[str]:
    """Names of the muscles that ended so in any frame."""
    is_ended_so = (solution.muscle_outcomes == outcome).any(axis=0)
    return [name for name, is_named in zip(solution.muscles, is_ended_so, strict=True) if is_named]


def _count(solution: MotionSolution, frames: list[int]) -> str:
    return f"{len(frames)} of {len(solution.time)} frames, the first at {solution.time[frames[0]]:g} s"


def _violation(solution: MotionSolution, frames: list[int], *, has_glenoid: bool) -> str:
    outside = np.maximum(-solution.cone_slack[frames], 0.0)
    leaves = f"leaves it by up to {outside.max():.3g} N and " if has_glenoid else ""
    missed = solution.equality_residual[frames].max()
    return f"; the smallest violation {leaves}misses accelerations by up to {missed:.3g} rad/s² or m/s²"
