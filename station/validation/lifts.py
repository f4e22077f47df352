"""Solve the lifts of a folder in every variant and compare the joint force with the published and the measured one.

A folder has the lifts of a patient with an instrumented shoulder prosthesis:

NAME_as_solved.osim, NAME.mot            the model and its motion, with the load in the hand
NAME_measured_force.txt                  the joint force relative to the implant, with the body weight
NAME_measured_force_glenoid.txt          the same relative to the glenoid, if it is known
NAME_published_{none,circle,ellipse}.txt the published solutions, where there are any

Variants are those of the muscle-redundancy problem. `station validate` has a table, on the terminal and as CSV, and a
figure of measured and predicted force.
"""

from __future__ import annotations

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from rich.table import Table

from documents.message import Figures, Message, because
from recordings.errors import ForeignFile, RecordingCode
from recordings.exchange.joint_force import JointForceRecord, interpolate_samples, read_joint_force
from recordings.exchange.sample_tables import require_rising
from recordings.exchange.text import read_lines, read_numbers
from solver.errors import SolverError
from solver.model import Array, Model
from solver.motion import Kinematics, Motion, differentiate, read_motion
from solver.multibody.postures import postures
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import (
    ForceAgreement,
    angle_between,
    force_agreement,
    glenoid_axes,
    glenoid_cone,
    with_rim,
)
from solver.redundancy.motion_solution import solve_motion
from solver.redundancy.problem import FrameOutcome
from station.assessment.given_motion import motion_checks, motion_findings
from station.checksums import write_whole
from station.errors import StationError
from station.folders import require_folder
from station.messages.assessment_messages import AssessmentCode
from station.messages.study_messages import ValidationCode
from station.progress import Progress, silent
from station.report.plot import LINE, SHADES, STYLE, as_png

LARGEST_MEDIAN_N, LARGEST_EXCESS_PERCENT = 5.0, 1.0
"""Median difference from the published force [N]; RMSE above the published one [% of body weight]."""
LEAST_CORRELATION = 0.8
"""Of predicted and measured force; 0.93 or more in the public lifts."""
MODEL, IMPLANT, GLENOID = "_as_solved.osim", "_measured_force.txt", "_measured_force_glenoid.txt"
PUBLISHED = "_published_{variant}.txt"
FORCE = ("time", "Fx", "Fy", "Fz")
LARGEST_DIFFERENCE_N = 2.0
"""Between the two records of one force; 0.9 N in the public lifts."""
TIME_TOLERANCE_S = 1e-4
GIRDLE_AND_SHOULDER = (
    "scapula_abduction",
    "scapula_elevation",
    "scapula_upward_rot",
    "scapula_winging",
    "plane_elv",
    "shoulder_elv",
    "axial_rot",
)
"""Coordinates whose actuators have the published weight of 10."""
CUTOFF_HZ = 3.0


@dataclass(frozen=True, eq=False)
class SolvedVariant:
    """A lift in one variant, compared. Forces are sizes [N] at time (frames,) [s]; NaN where a frame is unsolved.

    agreement           of our force with the measured one, over the frames that are compared
    angle               median between predicted and measured direction [rad], not evaluated (docs/validation.md); NaN
                        if the force relative to the glenoid is not known
    published           agreement of the published force with the measured one; None without a published solution
    published_span      first and last time of the published solution [s]
    median_difference   |our force − the published one| as vectors, median over the frames [N]
    compared            number of frames with a measured force and, where there is a published solution, a published one
    is_whole            whether the published solution lasts as long as the motion; True without one
    unsolved            number of frames
    findings            on the lift's files and motion, the same in every variant
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
    published_span: tuple[float, float] | None
    median_difference: float | None
    compared: int
    is_whole: bool
    unsolved: int
    findings: Sequence[Message[AssessmentCode] | Message[ValidationCode]] = ()

    @property
    def figures(self) -> Figures:
        """Lift, variant, and numbers of frames: all, unsolved and compared ones."""
        counts = {"frames": len(self.time), "unsolved": self.unsolved, "compared": self.compared}
        return {"lift": self.lift, "variant": self.variant, **counts}

    @property
    def rmse_percent(self) -> float:
        """RMSE to the measured force [% of body weight]."""
        return 100.0 * self.agreement.rmse / self.body_weight

    @property
    def published_rmse_percent(self) -> float | None:
        """RMSE of the published force [% of body weight]."""
        return None if self.published is None else 100.0 * self.published.rmse / self.body_weight

    @property
    def is_within_limits(self) -> bool | None:
        """Whether it agrees with the published solution; None without one."""
        if self.published_rmse_percent is None or self.median_difference is None:
            return None
        is_close = self.median_difference <= LARGEST_MEDIAN_N
        return is_close and self.rmse_percent <= self.published_rmse_percent + LARGEST_EXCESS_PERCENT

    @property
    def is_complete(self) -> bool:
        """Whether every frame is solved and compared, and no file was cut."""
        is_cut = any(finding.code is AssessmentCode.ROW_COUNTS for finding in self.findings)
        return self.is_whole and not self.unsolved and not is_cut


@dataclass(frozen=True)
class RefusedLift:
    """A lift whose files cannot be used, and why."""

    name: str
    error: ValidationFileError | ForeignFile | SolverError

    @property
    def message(self) -> Message[ValidationCode]:
        """The lift and the sentence of its error."""
        return Message(ValidationCode.LIFT_LEFT_OUT, {"lift": self.name, **because(self.error)})


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
    size, measured = np.linalg.norm(force, axis=1), lift.measured.at(solution.time)[1]
    published = lift.published.get(variant.name)
    theirs = published.at(solution.time) if published else None
    if theirs is not None and np.isnan(theirs).all():
        raise _refusal(ValidationCode.TIMES_DIFFER, lift=lift.name, variant=variant.name)
    is_compared = np.isfinite(measured) if theirs is None else np.isfinite(measured) & np.isfinite(theirs[:, 0])
    reference = np.where(is_compared, measured, np.nan)
    return SolvedVariant(
        lift=lift.name,
        variant=variant.name,
        time=solution.time,
        force=size,
        measured_force=measured,
        body_weight=lift.body_weight,
        agreement=force_agreement(size, reference),
        angle=_angle(lift, model, kinematics, force),
        published=None if theirs is None else force_agreement(np.linalg.norm(theirs, axis=1), reference),
        published_span=None if published is None else (float(published.time[0]), float(published.time[-1])),
        median_difference=None if theirs is None else _median(np.linalg.norm(force - theirs, axis=1)),
        compared=int(is_compared.sum()),
        is_whole=published is None or _lasts_as_long(solution.time, published.time),
        unsolved=int((~is_solved).sum()),
        findings=(*lift.notes, *lift_findings(lift)),
    )


def lift_findings(lift: MeasuredLift) -> list[Message[AssessmentCode]]:
    """Findings on the motion of a lift, such as degrees that were read as radians."""
    return motion_findings(motion_checks(lift.model, differentiate(lift.motion, CUTOFF_HZ)))


def verdicts(solved: list[SolvedVariant]) -> Iterator[Message[ValidationCode]]:
    """Unsolved frames, frames without a published force, and whether the published variants are within the limits."""
    for found in solved:
        if found.unsolved:
            yield Message(ValidationCode.UNSOLVED, found.figures)
        if found.published_span is not None and not found.is_whole:
            spans = _span("", found.time) | _span("published_", found.published_span)
            yield Message(ValidationCode.PARTLY_PUBLISHED, {**found.figures, **spans})
    yield from _low_correlations(solved)
    judged = [found for found in solved if found.is_within_limits is not None]
    beyond = [f"{found.lift}, {found.variant}" for found in judged if not found.is_within_limits]
    limits = {"difference_n": LARGEST_MEDIAN_N, "rmse_percent": LARGEST_EXCESS_PERCENT}
    if beyond:
        yield Message(ValidationCode.BEYOND_LIMITS, {"variants": "; ".join(beyond)})
    elif judged:
        yield Message(ValidationCode.WITHIN_LIMITS, {"count": len(judged), **limits})
    else:
        yield Message(ValidationCode.NOTHING_PUBLISHED)


def _low_correlations(solved: Sequence[SolvedVariant]) -> Iterator[Message[ValidationCode]]:
    """Lifts whose measured force no variant follows."""
    for lift in dict.fromkeys(found.lift for found in solved):
        best = max(found.agreement.correlation for found in solved if found.lift == lift)
        if best < LEAST_CORRELATION:
            figures: Figures = {"lift": lift, "correlation": best, "expected": LEAST_CORRELATION}
            yield Message(ValidationCode.LOW_CORRELATION, figures)


def _span(prefix: str, time: Sequence[float] | Array) -> dict[str, float]:
    return {f"{prefix}start_s": float(time[0]), f"{prefix}end_s": float(time[-1])}


def _step(time: Array) -> float:
    """Median time between two samples [s]."""
    return float(np.median(np.diff(time))) if len(time) > 1 else TIME_TOLERANCE_S


def _lasts_as_long(time: Array, published: Array) -> bool:
    """Whether both begin and end at the same time, within a step."""
    ends = abs(time[0] - published[0]), abs(time[-1] - published[-1])
    return float(max(ends)) <= max(_step(time), _step(published)) + TIME_TOLERANCE_S


def _median(values: Array) -> float:
    """Of the values that are known; NaN without one."""
    known = values[np.isfinite(values)]
    return float(np.median(known)) if len(known) else np.nan


def _angle(lift: MeasuredLift, model: Model, kinematics: Kinematics, force: Array) -> float:
    """Median angle [rad] between a force (frames, 3) in ground and the one measured relative to the glenoid."""
    if lift.in_glenoid is None:
        return np.nan
    cone = glenoid_cone(model)
    scapula = postures(model, kinematics.positions, kinematics.speeds).rotation_to_ground[:, cone.body]
    in_glenoid = np.einsum("ij,fkj,fk->fi", glenoid_axes(cone.axis, cone.edge), scapula, force)  # axes · Rᵀ · force
    return _median(angle_between(in_glenoid, lift.in_glenoid.at(kinematics.time)[0]))


class ValidationFileError(StationError):
    """A folder or a file that does not make a lift with a measured force."""


def _refusal(code: ValidationCode, **figures: float | str) -> ValidationFileError:
    return ValidationFileError(Message(code, figures))


@dataclass(frozen=True, eq=False)
class PublishedForce:
    """Force (frames, 3) [N] on the scapula in ground of a published solution, at time (frames,) [s]."""

    time: Array
    force: Array

    def at(self, time: Array) -> Array:
        """(frames, 3) at time (frames,) [s], linear between the samples; NaN where there is none."""
        force = interpolate_samples(time, self.time, self.force, 1.5 * _step(self.time))
        force[(time < self.time[0] - TIME_TOLERANCE_S) | (time > self.time[-1] + TIME_TOLERANCE_S)] = np.nan
        return force


@dataclass(frozen=True, eq=False)
class MeasuredLift:
    """A lift: model, motion, the measured force, body weight [N], and published solutions.

    measured    relative to the implant, for the size
    in_glenoid  relative to the glenoid, for the direction; None where it is not known
    notes       on the files
    """

    name: str
    model: Model
    motion: Motion
    measured: JointForceRecord
    in_glenoid: JointForceRecord | None
    body_weight: float
    published: Mapping[str, PublishedForce]
    notes: tuple[Message[ValidationCode], ...] = ()


def find_lifts(folder: Path) -> list[str]:
    """Names of the lifts in a folder, in alphabetical order. Raises ValidationFileError where there is none."""
    require_folder(folder, ValidationFileError)
    names = sorted(path.name.removesuffix(MODEL) for path in folder.glob(f"*{MODEL}"))
    if not names:
        raise _refusal(ValidationCode.NO_LIFT, path=str(folder))
    return names


def read_lift(folder: Path, name: str, variants: tuple[str, ...]) -> MeasuredLift:
    """A lift with the published solutions of these variants. Raises ValidationFileError, ForeignFile, SolverError."""
    needed = [f"{name}.mot", name + IMPLANT]
    if missing := [file for file in needed if not (folder / file).is_file()]:
        raise _refusal(ValidationCode.FILES_MISSING, lift=name, path=str(folder), missing=", ".join(missing))
    model = read_osim(folder / (name + MODEL))
    implant = read_joint_force(folder / (name + IMPLANT))
    if implant.body_weight is None:
        raise _refusal(ValidationCode.NO_BODY_WEIGHT, file=name + IMPLANT)
    glenoid = read_joint_force(folder / (name + GLENOID)) if (folder / (name + GLENOID)).is_file() else None
    if glenoid is not None:
        _ensure_same_force(name, implant, glenoid)
    motion = read_motion(folder / f"{name}.mot", model)
    last = float(implant.time_s[-1])
    if motion.time[-1] > last + TIME_TOLERANCE_S or motion.time[0] < -TIME_TOLERANCE_S:
        raise _refusal(
            ValidationCode.NOT_COVERED, lift=name, file=name + IMPLANT, last_s=last, **_span("", motion.time)
        )
    files = {variant: folder / (name + PUBLISHED.format(variant=variant)) for variant in variants}
    published = {variant: read_published_force(path) for variant, path in files.items() if path.is_file()}
    notes = tuple(_notes(folder, name, implant, files))
    return MeasuredLift(name, model, motion, implant, glenoid, implant.body_weight, published, notes)


def read_published_force(path: Path) -> PublishedForce:
    """Read the force of a published solution: a table with commas, and columns time, Fx, Fy, Fz among others.

    Raises ForeignFile.
    """
    lines = read_lines(path)
    titles = [title.strip() for title in lines[0].split(",")]
    if missing := [title for title in FORCE if titles.count(title) != 1]:
        sentence = f"{path} has {len(titles)} columns and not one {', one '.join(missing)}; use a published solution"
        raise ForeignFile(sentence, RecordingCode.FOREIGN_MISSING_COLUMN)
    for number, line in enumerate(lines[1:], start=2):
        if (found := len(line.split(","))) != len(titles):
            sentence = f"{path} has {found} columns in line {number}, expected {len(titles)}; the file may be cut"
            raise ForeignFile(f"{sentence}, download it again", RecordingCode.FOREIGN_CUT)
    table = read_numbers(lines[1:], ",", [titles.index(title) for title in FORCE], path, 2)
    require_rising(table[:, 0], f"{path}, time,", 2)
    holes = np.flatnonzero(~np.isfinite(table).all(axis=1))
    if len(holes):
        sentence = f"{path} has no force in line {holes[0] + 2}, expected one at every time; download it again"
        raise ForeignFile(sentence, RecordingCode.FOREIGN_NOT_A_NUMBER)
    return PublishedForce(table[:, 0], table[:, 1:])


def _notes(
    folder: Path, name: str, implant: JointForceRecord, files: Mapping[str, Path]
) -> Iterator[Message[ValidationCode]]:
    """Findings on the names of published solutions and on the times of the record."""
    if implant.is_cut:
        yield Message(ValidationCode.START_NOT_MARKED, {"file": name + IMPLANT})
    found = {path.name for path in folder.glob(name + PUBLISHED.format(variant="*"))}
    expected = {path.name for path in files.values()}
    if found and (missing := expected - found):
        yield Message(ValidationCode.PUBLISHED_MISSING, {"files": ", ".join(sorted(missing))})
    if expected and (unused := found - expected):
        figures = {"files": ", ".join(sorted(unused)), "variants": ", ".join(files)}
        yield Message(ValidationCode.PUBLISHED_UNUSED, figures)


def _ensure_same_force(name: str, implant: JointForceRecord, glenoid: JointForceRecord) -> None:
    same = implant.at(glenoid.time_s)[1]
    worst = float(np.nanmax(np.abs(same - glenoid.resultant)))
    if worst > LARGEST_DIFFERENCE_N:
        raise _refusal(ValidationCode.DIFFERENT_FORCES, lift=name, difference_n=worst, limit_n=LARGEST_DIFFERENCE_N)


@dataclass(frozen=True)
class Variant:
    """A published variant of Hasan et al. (2025), or our defaults.

    rim  (along, across) tangents of the glenoid's rim, along the direction of its edge marker and across it; None for
         no cone, or in the defaults for the rim of the model's markers
    """

    name: str
    rim: tuple[float, float] | None
    is_published: bool

    def applied(self, model: Model) -> tuple[Model, RedundancyOptions]:
        """The model and the options of the variant."""
        if not self.is_published:
            return model, RedundancyOptions()
        options = published_options(model)
        if self.rim is None:
            return model, replace(options, has_glenoid_cone=False)
        along, across = self.rim
        return with_rim(model, along), replace(options, glenoid_aspect=across / along)


PUBLISHED_VARIANTS = (
    Variant("none", None, is_published=True),
    Variant("circle", (0.5, 0.5), is_published=True),
    Variant("ellipse", (0.34, 0.61), is_published=True),
)
VARIANTS = (*PUBLISHED_VARIANTS, Variant("defaults", None, is_published=False))


def published_options(model: Model) -> RedundancyOptions:
    """Weights of 1, but 10 on the actuators of scapulothoracic and glenohumeral coordinates; nothing is unweighted."""
    weights = {name: 10.0 for name in GIRDLE_AND_SHOULDER if name in model.actuated_names}
    return RedundancyOptions(unweighted_coordinates=(), reserve_weight=1.0, weights=weights)


NOTE = (
    "ΔF: median difference from the published force. RMSE in % of body weight, in brackets that of the published "
    "force; r; peaks, predicted / measured; angle to the measured force, which is not evaluated."
)
UNKNOWN = ForceAgreement(math.nan, math.nan, math.nan)


def validation_table(solved: Sequence[SolvedVariant]) -> Table:
    """A row per lift and variant; the RMSE of the published solution in brackets."""
    table = Table(
        "lift", "variant", "ΔF [N]", "RMSE [%]", "r", "peaks", "angle", "limits", caption=NOTE, show_edge=False
    )
    for found in solved:
        ours, theirs = found.agreement, found.published_rmse_percent
        table.add_row(
            found.lift,
            found.variant,
            "" if found.median_difference is None else f"{found.median_difference:.1f}",
            f"{found.rmse_percent:.1f}" + ("" if theirs is None else f" ({theirs:.1f})"),
            f"{ours.correlation:.3f}",
            f"{ours.peak_ratio:.2f}",
            "" if math.isnan(found.angle) else f"{np.degrees(found.angle):.0f}°",
            {True: "met", False: "exceeded", None: ""}[found.is_within_limits],
        )
    return table


def write_validation(path: Path, solved: Sequence[SolvedVariant]) -> None:
    """A row per lift and variant, at least one; figures are of the `compared` frames, empty without a published one."""
    rows = [_row(found) for found in solved]
    write_whole(path, "\n".join([",".join(rows[0]), *(",".join(row.values()) for row in rows)]) + "\n")


def _row(found: SolvedVariant) -> dict[str, str]:
    """Column → text."""
    ours, theirs = found.agreement, found.published or UNKNOWN
    figures = {
        "median_difference_from_published_n": found.median_difference,
        "rmse_percent_of_body_weight": found.rmse_percent,
        "published_rmse_percent_of_body_weight": found.published_rmse_percent,
        "correlation": ours.correlation,
        "published_correlation": theirs.correlation,
        "peak_ratio": ours.peak_ratio,
        "published_peak_ratio": theirs.peak_ratio,
        "angle_to_measured_deg": math.degrees(found.angle),
    }
    texts = {key: str(one) for key, one in found.figures.items()} | {key: _field(one) for key, one in figures.items()}
    return texts | {"is_within_limits": {True: "true", False: "false", None: ""}[found.is_within_limits]}


def _field(figure: float | None) -> str:
    return "" if figure is None or math.isnan(figure) else f"{figure:.6g}"


DASHES = ("-", "--", "-.", ":")
LABELS = {
    "none": "published weights, no cone",
    "circle": "published weights, circular cone",
    "ellipse": "published weights, elliptic cone",
    "defaults": "defaults of the solver",
}


def draw_forces(path: Path, solved: Sequence[SolvedVariant]) -> None:
    """A panel per lift: measured force, and predicted force in every variant. As .svg or .png, by the suffix."""
    lifts = list(dict.fromkeys(found.lift for found in solved))
    with mpl.rc_context({**STYLE, "svg.hashsalt": "forces", "svg.fonttype": "none"}):
        figure = Figure(figsize=(1.0 + 4.2 * len(lifts), 3.4), layout="constrained")
        panels = figure.subplots(1, len(lifts), sharey=True, squeeze=False)[0]
        for panel, lift in zip(panels, lifts, strict=True):
            variants = [found for found in solved if found.lift == lift]
            measured = 100.0 * variants[0].measured_force / variants[0].body_weight
            panel.plot(variants[0].time, measured, color=LINE, linewidth=2.2, label="measured")
            for place, found in enumerate(variants):
                label = LABELS.get(found.variant, found.variant)
                style = {"color": SHADES[place % len(SHADES)], "linestyle": DASHES[place % len(DASHES)]}
                panel.plot(found.time, 100.0 * found.force / found.body_weight, label=label, **style)
            panel.set(title=lift, xlabel="time [s]")
        panels[0].set(ylabel="joint force [% of body weight]", ylim=(0, None))
        panels[0].legend(fontsize="x-small")
        write_whole(path, as_png(figure) if path.suffix == ".png" else _as_svg(figure))


def _as_svg(figure: Figure) -> bytes:
    """Without a date: the same figure gives the same bytes."""
    drawn = io.BytesIO()
    figure.savefig(drawn, format="svg", metadata={"Date": None, "Creator": None})
    return drawn.getvalue()
