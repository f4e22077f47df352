"""The solver's outcome codes as sentences."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from solver.model import Model
from solver.muscle import MuscleOutcome
from solver.redundancy.motion_solution import MotionSolution
from solver.redundancy.problem import FrameOutcome

if TYPE_CHECKING:
    from solver.tendons.fiber import ElasticForces  # the compiler behind it takes long to import

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
    MuscleOutcome.FIBER_NOT_CONVERGED: "fibre and elastic tendon did not come into balance; the last point is used",
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


def describe_tendons(model: Model, fibers: ElasticForces | None) -> str:
    """Which are elastic, with their strain, and fibres that were held at their least length."""
    if fibers is None:
        return "rigid"
    tendons = [model.muscles[index].tendon for index in fibers.elastic]
    strains = sorted({tendon.strain for tendon in tendons if tendon is not None})
    described = (
        f"elastic in {len(tendons)} of {len(model.muscles)} muscles, strain at the greatest isometric force "
        f"{' to '.join(f'{strain:g}' for strain in strains[:1] + strains[1:][-1:])}"
    )
    held = np.flatnonzero(fibers.is_shortest.any(axis=0))
    if not len(held):
        return described
    names = " ".join(model.muscle_names[index] for index in held)
    frames = int(fibers.is_shortest.any(axis=1).sum())
    return f"{described}; fibre held at its least length in {frames} frames of {names}"


def muscles_with(solution: MotionSolution, outcome: MuscleOutcome) -> list[str]:
    """Names of the muscles that ended so in any frame."""
    is_ended_so = (solution.muscle_outcomes == outcome).any(axis=0)
    return [name for name, is_named in zip(solution.muscles, is_ended_so, strict=True) if is_named]


def _count(solution: MotionSolution, frames: list[int]) -> str:
    return f"{len(frames)} of {len(solution.time)} frames, the first at {solution.time[frames[0]]:g} s"


def _violation(solution: MotionSolution, frames: list[int], *, has_glenoid: bool) -> str:
    known = [frame for frame in frames if np.isfinite(solution.equality_residual[frame])]
    if not known:  # Clarabel stopped at a point that is not finite
        return ""
    outside = np.maximum(-solution.cone_slack[known], 0.0)
    leaves = f"leaves it by up to {outside.max():.3g} N and " if has_glenoid else ""
    worst = max(known, key=lambda frame: float(solution.equality_residual[frame]))
    missed, coordinate = solution.equality_residual[worst], solution.residual_coordinates[worst]
    return (
        f"; the smallest violation {leaves}misses accelerations by up to {missed:.3g} rad/s² or m/s², "
        f"the most that of {coordinate}"
    )
