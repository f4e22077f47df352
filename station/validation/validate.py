"""Solve the lifts of a folder in every variant and compare the joint force with the published and the measured one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.errors import ForeignFile
from solver.errors import SolverError
from solver.motion import differentiate
from solver.multibody.postures import postures
from solver.redundancy.force_agreement import ForceAgreement, angle_between, force_agreement, glenoid_axes
from solver.redundancy.glenoid import glenoid_cone
from solver.redundancy.motion import solve_motion
from solver.redundancy.sequence import FrameOutcome
from station.assessment.motion_checks import motion_checks, motion_findings
from station.messages.codes import AssessmentCode
from station.messages.message import Message
from station.messages.validation_codes import ValidationCode
from station.progress import Progress, silent
from station.validation.lifts import TIME_TOLERANCE_S, MeasuredLift, ValidationFileError, find_lifts, read_lift
from station.validation.variants import CUTOFF_HZ, PUBLISHED_VARIANTS, VARIANTS, Variant

Array = NDArray[np.float64]

LARGEST_MEDIAN_N, LARGEST_EXCESS_PERCENT = 5.0, 1.0
"""Median difference from the published force [N]; RMSE above the published one [% of body weight]."""


@dataclass(frozen=True, eq=False)
class SolvedVariant:
    """A lift in one variant, compared. Forces are sizes [N] at time (frames,) [s]; NaN where a frame is unsolved.

    angle               median between predicted and measured direction [rad], not evaluated (docs/validation.md); NaN
                        if the force relative to the glenoid is not known
    published           agreement of the published force with the measured one; None without a published solution
    common_rmse         of our force over the frames that have a published one [N]; None without one
    median_difference   |our force − the published one| as vectors, median over the frames [N]
    published_frames    number of frames of the published solution, 0 without one
    compared            number of frames that have a published force
    unsolved            number of frames
    findings            of the lift's motion, the same in every variant
    """

    lift: str
    variant: str
    time: Array
    force: Array
    measured_force: Array
    body_weight: float
    agreement: ForceAgreement
    angle: float
    published: ForceAgreement | None
    common_rmse: float | None
    median_difference: float | None
    published_frames: int
    compared: int
    unsolved: int
    findings: Sequence[Message[AssessmentCode]] = ()

    @property
    def rmse_percent(self) -> float:
        """RMSE to the measured force [% of body weight]."""
        return 100.0 * self.agreement.rmse / self.body_weight

    @property
    def common_rmse_percent(self) -> float | None:
        """RMSE over the frames that have a published force [% of body weight]; None without one."""
        return None if self.common_rmse is None else 100.0 * self.common_rmse / self.body_weight

    @property
    def published_rmse_percent(self) -> float | None:
        """RMSE of the published force [% of body weight]."""
        return None if self.published is None else 100.0 * self.published.rmse / self.body_weight

    @property
    def is_within_limits(self) -> bool | None:
        """Whether it agrees with the published solution; None without one."""
        if self.published_rmse_percent is None or self.median_difference is None or self.common_rmse_percent is None:
            return None
        is_close = self.median_difference <= LARGEST_MEDIAN_N
        return is_close and self.common_rmse_percent <= self.published_rmse_percent + LARGEST_EXCESS_PERCENT


@dataclass(frozen=True)
class RefusedLift:
    """A lift whose files cannot be used, and why."""

    name: str
    error: ValidationFileError | ForeignFile | SolverError

    @property
    def message(self) -> Message[ValidationCode]:
        """The lift and the sentence of its error."""
        return Message(ValidationCode.LIFT_LEFT_OUT, {"lift": self.name, "reason": str(self.error)})


def validate_folder(folder: Path, progress: Progress = silent) -> tuple[list[SolvedVariant], list[RefusedLift]]:
    """Every lift of the folder in every variant, and the lifts that are refused.

    Raises the error of the first lift if none can be solved, and ValidationFileError for the folder.
    """
    names = find_lifts(folder)
    solved: list[SolvedVariant] = []
    refused: list[RefusedLift] = []
    for done, name in enumerate(names):
        try:
            lift = read_lift(folder, name, tuple(variant.name for variant in PUBLISHED_VARIANTS))
            solved += [solve_variant(lift, variant) for variant in VARIANTS]
        except (ValidationFileError, ForeignFile, SolverError) as error:
            refused.append(RefusedLift(name, error))
        if solved:
            progress("solving lifts", done + 1, len(names))
    if not solved:
        raise refused[0].error
    return solved, refused


def solve_variant(lift: MeasuredLift, variant: Variant) -> SolvedVariant:
    """Solve a lift in one variant, over the whole of its motion, with the published low-pass filter."""
    model, options = variant.applied(lift.model)
    kinematics = differentiate(lift.motion, CUTOFF_HZ)
    solution = solve_motion(model, kinematics, options)
    is_solved = np.array([outcome is FrameOutcome.SOLVED for outcome in solution.outcomes])
    force = np.where(is_solved[:, None], solution.reaction[:, 3:], np.nan)
    measured, resultant = lift.measured.at(solution.time)
    cone = glenoid_cone(model)
    scapula = postures(model, kinematics.positions, kinematics.speeds).rotation_to_ground[:, cone.body]
    in_glenoid = np.einsum("ij,fkj,fk->fi", glenoid_axes(cone.axis, cone.edge), scapula, force)  # axes · Rᵀ · force
    published, difference, is_common = _beside_published(lift, variant, solution.time, force, resultant)
    size = np.linalg.norm(force, axis=1)
    common = None if published is None else force_agreement(size[is_common], resultant[is_common]).rmse
    angles = angle_between(in_glenoid, measured)
    has_angle = lift.is_in_glenoid and np.isfinite(angles).any()
    return SolvedVariant(
        lift=lift.name,
        variant=variant.name,
        time=solution.time,
        force=size,
        measured_force=resultant,
        body_weight=lift.body_weight,
        agreement=force_agreement(size, resultant),
        angle=float(np.nanmedian(angles)) if has_angle else np.nan,
        published=published,
        common_rmse=common,
        median_difference=difference,
        published_frames=len(lift.published[variant.name].time) if published is not None else 0,
        compared=int(is_common.sum()),
        unsolved=int((~is_solved).sum()),
        findings=findings_of(lift),
    )


def findings_of(lift: MeasuredLift) -> list[Message[AssessmentCode]]:
    """What the checks of a motion find in that of a lift, such as degrees that were read as radians."""
    return motion_findings(motion_checks(lift.model, differentiate(lift.motion, CUTOFF_HZ)))


def verdicts(solved: list[SolvedVariant]) -> Iterator[Message[ValidationCode]]:
    """Unsolved frames, frames without a published force, and whether the published variants are within the limits."""
    for found in solved:
        if found.unsolved:
            frames = {"unsolved": found.unsolved, "frames": len(found.time)}
            yield Message(ValidationCode.UNSOLVED, {**frames, "lift": found.lift, "variant": found.variant})
        if found.published is not None and found.compared < max(len(found.time), found.published_frames):
            frames = {"compared": found.compared, "frames": len(found.time), "published": found.published_frames}
            yield Message(ValidationCode.PARTLY_PUBLISHED, {**frames, "lift": found.lift, "variant": found.variant})
    judged = [found for found in solved if found.is_within_limits is not None]
    beyond = [f"{found.lift}, {found.variant}" for found in judged if not found.is_within_limits]
    limits = {"difference_n": LARGEST_MEDIAN_N, "rmse_percent": LARGEST_EXCESS_PERCENT}
    if beyond:
        yield Message(ValidationCode.BEYOND_LIMITS, {"variants": "; ".join(beyond)})
    elif judged:
        yield Message(ValidationCode.WITHIN_LIMITS, {"count": len(judged), **limits})
    else:
        yield Message(ValidationCode.NOTHING_PUBLISHED)


def _beside_published(
    lift: MeasuredLift, variant: Variant, time: Array, force: Array, measured: Array
) -> tuple[ForceAgreement | None, float | None, NDArray[np.bool_]]:
    """Agreement of the published force with the measured one, the median difference of the predicted one from it [N],
    and whether a frame (frames,) has a published force.
    """
    published = lift.published.get(variant.name)
    if published is None:
        return None, None, np.zeros(len(time), dtype=bool)
    place = np.searchsorted(published.time, time - TIME_TOLERANCE_S).clip(max=len(published.time) - 1)
    is_common = np.abs(published.time[place] - time) <= TIME_TOLERANCE_S
    if not is_common.any():
        raise ValidationFileError(Message(ValidationCode.TIMES_DIFFER, {"lift": lift.name, "variant": variant.name}))
    theirs = np.where(is_common[:, None], published.force[place], np.nan)
    difference = np.linalg.norm(force - theirs, axis=1)
    known = difference[np.isfinite(difference)]
    agreement = force_agreement(np.linalg.norm(theirs, axis=1), measured)
    return agreement, float(np.median(known)) if len(known) else np.nan, is_common
