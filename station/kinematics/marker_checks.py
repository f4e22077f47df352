"""Checks of markers and of a person's body: refusals before anything is solved, findings on what was solved.

A file with markers on a body is read as a table under the names of the model's markers. Of a body, masses, sizes,
marker places and postures are checked.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from documents.message import Code, Figures, Message
from recordings.exchange.c3d import read_c3d_markers
from recordings.exchange.qtm_tsv import read_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc
from recordings.standard_gravity import g
from solver.inverse_kinematics.marker_fit import Exchange, find_exchanges, fit_markers
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome, PostureUncertainty, TrackingTasks
from solver.model import Array, CoordinateLock, Marker, Model
from solver.osim.tool_setups import IkSetup, ScaleSetup
from solver.personalisation.anthropometry import ARM_SEGMENTS
from solver.personalisation.estimate import BodyEstimate, EstimateOutcome
from solver.personalisation.segment_masses import (
    HAND,
    UPPER_ARM,
    TendonChange,
    mass_ratios,
    segment_masses,
    upper_arm_length,
    usual_masses,
)
from solver.scaling import largest_motion
from station.errors import StationError
from station.exit_code import WRONG_USAGE
from station.messages.kinematics_messages import KinematicsCode, PersonCode

Finding = Message[Code]

LEAST_SEEN = 0.6
"""Part of the expected markers that most frames must show."""
SIZES = (0.2, 5.0)
"""Least and largest spread of the markers beside that of the model's; a wrong unit is a factor of 10."""
MOST_RESIDUAL = 0.08
"""m, RMS; unscaled models on published persons have 0.03, on persons 20 % larger 0.06; wrong labels, 0.1 and more."""
MIRROR_RATIO, LEAST_MIRROR_RESIDUAL = 1.5, 0.02
"""Markers of the other side are refused where the mirror image fits better by this factor, from this RMS [m] on. On
published trials of the right side the mirror image fits worse by factors of 1.9 to 4."""
FAR = 0.25
"""m, of a marker from its place on the model in one frame; unscaled models on published persons have at most 0.08."""
MOST_TILT = math.radians(60)
LEAST_OF_A_PERSON = 3
"""Markers under one prefix that make another person, or the other side."""
UNSOLVED = {
    PostureOutcome.NOT_CONVERGED: KinematicsCode.NOT_CONVERGED,
    PostureOutcome.GAP_OPEN: KinematicsCode.GAP_OPEN,
    PostureOutcome.NO_MARKERS: KinematicsCode.NO_MARKERS,
}
MOST_DEVIATIONS = 3.5
"""Of a marker's offset, over the three axes together, before it is a finding."""
BEYOND_RANGE = np.radians(20.0)
MOST_BODY_WEIGHTS = 5.0
"""Of the force in the joint. Instrumented shoulders measured up to 2 (docs/validation.md), and models have shown up to
2.1 times the measured peak (docs/motion.md).
"""
SWAYING, MOVING = 0.02, 0.10
"""m, that a marker goes in a static pose: more than postural sway; and no pose."""


def setup_findings(file: str, setup: IkSetup | ScaleSetup, unknown: Collection[str]) -> tuple[Finding, ...]:
    """Findings on a set-up: elements that are not used, files that are elsewhere, and the names that are unknown."""
    found = {KinematicsCode.FILE_ELSEWHERE: ("files", setup.moved), KinematicsCode.NOT_IN_MODEL: ("names", unknown)}
    others = (Message(code, {"file": file, key: ", ".join(names)}) for code, (key, names) in found.items() if names)
    return *unused_findings(file, setup.unused), *others


def unused_findings(file: str, elements: Collection[str]) -> tuple[Finding, ...]:
    """A finding on the elements of a file that are not used, if there are any."""
    figures: Figures = {"file": file, "elements": ", ".join(elements)}
    return (Message(KinematicsCode.UNUSED_ELEMENTS, figures),) if elements else ()


def unattached_findings(file: str, markers: Collection[str]) -> tuple[Finding, ...]:
    """A finding on the markers that a file attaches to bodies that the model lacks, if there are any."""
    figures: Figures = {"file": file, "markers": ", ".join(markers)}
    return (Message(KinematicsCode.UNATTACHED, figures),) if markers else ()


def ensure_markers_fit(
    model: Model, file: str, expected: Collection[str], tasks: TrackingTasks, observed: Array
) -> tuple[Finding, ...]:
    """Refuse markers that are too few, of the other side or of another body; findings on what is odd and possible.

    expected are the names that the set-up follows and the model has; observed (frames, markers, 3) [m] in the order of
    tasks. Raises KinematicsError.
    """
    if len(expected) == 1:  # which has no size
        figures = {"file": file, "model": model.name, "name": next(iter(expected))}
        raise KinematicsError(Message(KinematicsCode.ONE_IN_COMMON, figures))
    shown = np.isfinite(observed).all(axis=2)
    most = float(np.median(shown.sum(axis=1)))
    if most < LEAST_SEEN * len(expected):
        seen = {
            marker.name for marker, is_shown in zip(tasks.markers, shown.mean(axis=0), strict=True) if is_shown > 0.5
        }
        figures = {"file": file, "seen": f"{most:g}", "expected": str(len(expected))}
        missing = ", ".join(sorted(set(expected) - seen))
        raise KinematicsError(Message(KinematicsCode.MARKERS_MISSING, {**figures, "missing": missing}))
    fit = fit_markers(model, observed, tasks)
    figures = {"file": file, "model": model.name}
    if not SIZES[0] <= fit.size <= SIZES[1]:
        raise KinematicsError(Message(KinematicsCode.WRONG_SIZE, {**figures, "size": fit.size}))
    rms = {"given_mm": 1e3 * fit.as_given, "mirrored_mm": 1e3 * fit.mirrored, "limit_mm": 1e3 * MOST_RESIDUAL}
    if fit.as_given > max(LEAST_MIRROR_RESIDUAL, MIRROR_RATIO * fit.mirrored):
        raise KinematicsError(Message(KinematicsCode.MIRRORED, {**figures, **rms}))
    if fit.as_given > MOST_RESIDUAL:
        raise KinematicsError(Message(KinematicsCode.NO_FIT, {**figures, **rms}))
    if fit.tilt > MOST_TILT:
        return (Message(KinematicsCode.TILTED, {"tilt_deg": math.degrees(fit.tilt)}),)
    return ()


def find_in_markers(time: Array, tasks: TrackingTasks, observed: Array) -> tuple[Finding, ...]:
    """Markers that are exchanged for a while, one finding for each pair; time (frames,) [s]."""
    last = len(time) - 1
    intervals: dict[tuple[int, int], list[Exchange]] = {}
    for exchange in find_exchanges(observed):
        intervals.setdefault(exchange.markers, []).append(exchange)
    return tuple(
        Message(
            KinematicsCode.EXCHANGED,
            {
                "one": tasks.markers[one].name,
                "other": tasks.markers[other].name,
                "from_s": float(time[exchanges[0].start]),
                "to_s": float(time[min(max(exchange.stop for exchange in exchanges), last)]),
                "count": len(exchanges),
            },
        )
        for (one, other), exchanges in intervals.items()
    )


def seen_markers(markers: Sequence[Marker], observed: Array) -> list[Marker]:
    """Markers with a position in any frame of observed (frames, markers, 3)."""
    shown = np.isfinite(observed).all(axis=2).any(axis=0)
    return [markers[index] for index in np.flatnonzero(shown).tolist()]


def find_never_seen(expected: Collection[str], seen: Collection[Marker]) -> tuple[Finding, ...]:
    """Expected markers that no frame shows."""
    missing = sorted(set(expected) - {marker.name for marker in seen})
    return (Message(KinematicsCode.NEVER_SEEN, {"markers": ", ".join(missing)}),) if missing else ()


def find_far_markers(time: Array, tasks: TrackingTasks, solution: InverseKinematics) -> tuple[Finding, ...]:
    """The marker that is farthest from the model in frames where one is too far to be on this body."""
    residuals = np.nan_to_num(solution.residuals)
    farthest = np.where(residuals.max(axis=1) > FAR, residuals.argmax(axis=1), -1)
    found = []
    for index, marker in enumerate(tasks.markers):
        frames = np.flatnonzero(farthest == index)
        if len(frames):
            figures: Figures = {
                "marker": marker.name,
                "residual_mm": 1e3 * float(residuals[frames, index].max()),
                "frames": len(frames),
                "first_s": float(time[frames[0]]),
            }
            found.append(Message[Code](KinematicsCode.FAR, figures))
    return tuple(found)


def find_in_postures(
    model: Model, time: Array, solution: InverseKinematics, uncertainty: PostureUncertainty
) -> tuple[Finding, ...]:
    """Frames that are not solved, and coordinates that nothing determines."""
    found: list[Finding] = []
    for outcome, code in UNSOLVED.items():
        frames = [frame for frame, found_outcome in enumerate(solution.outcomes) if found_outcome is outcome]
        if frames:
            found.append(Message(code, {"frames": len(frames), "first_s": float(time[frames[0]])}))
    known = np.isfinite(solution.coordinates[:, 0])
    loose = (~uncertainty.is_held[known]).sum(axis=0)
    names = _by_count(model.coordinate_names, loose)
    found += [
        Message(KinematicsCode.NOT_HELD, {"coordinates": ", ".join(names[count]), "frames": count}) for count in names
    ]
    return tuple(found)


def finding_lines(findings: Sequence[Finding]) -> list[str]:
    """A sentence with its code for every finding."""
    return [f"{finding} [{finding.code.value}]" for finding in findings]


def _by_count(names: Sequence[str], counts: Array) -> dict[int, list[str]]:
    """Number of frames → names, without 0."""
    found: dict[int, list[str]] = {}
    for name, count in zip(names, counts.tolist(), strict=True):
        if count:
            found.setdefault(count, []).append(name)
    return found


class KinematicsError(StationError):
    """Markers that do not fit the model or the set-up; the code states the reason."""


def read_body_markers(path: Path, names: Collection[str], prefix: str = "") -> MarkerTable:
    """Read a .trc, .c3d or QTM's .tsv; names are those of the markers of the model or the set-up.

    QTM puts the person's name before the labels of a skeleton: "Anna_C7". A prefix that is the only one of the file
    is removed. Raises ForeignFile, or KinematicsError for a file of several persons.
    """
    table = _read(path, [prefix + name for name in names] if prefix else names)
    groups = _groups(table.labels, names)
    if prefix and not any(prefix + name in table.labels for name in names):
        figures = {"file": path.name, "prefix": prefix, "found": ", ".join(filter(None, groups)) or "none"}
        raise KinematicsError(Message(KinematicsCode.NO_SUCH_PREFIX, figures))
    if not prefix and not any(label in names for label in table.labels):
        several = [start for start, labels in groups.items() if len(labels) >= LEAST_OF_A_PERSON]
        if len(several) > 1:
            shown = ", ".join(sorted(groups[start][0] for start in several))
            raise KinematicsError(Message(KinematicsCode.SEVERAL_PERSONS, {"file": path.name, "labels": shown}))
        prefix = max(groups, key=lambda start: len(groups[start]), default="")
        if prefix:
            note = f"{path.name} has {prefix!r} before its labels, which is removed"
            table = replace(_read(path, [prefix + name for name in names]), notes=(*table.notes, note))
    labels = tuple(
        label.removeprefix(prefix) if prefix and label.removeprefix(prefix) in names else label
        for label in table.labels
    )
    return replace(table, labels=labels)


def _read(path: Path, tracked: Collection[str]) -> MarkerTable:
    match path.suffix.lower():
        case ".c3d":
            return read_c3d_markers(path)
        case ".tsv" | ".txt":
            return read_qtm_tsv(path)
        case _:
            return read_trc(path, tracked=tracked)


def _groups(labels: Sequence[str], names: Collection[str]) -> dict[str, list[str]]:
    """Text before the names or, for repeated labels, after them, with the labels that have it."""
    groups: dict[str, list[str]] = {}
    for label in labels:
        base, mark, number = label.rpartition("#")
        if mark and base in names:
            groups.setdefault(f"#{number}", []).append(label)
            continue
        name = max((name for name in names if name and label.endswith(name) and label != name), key=len, default=None)
        if name is not None:
            groups.setdefault(label.removesuffix(name), []).append(label)
    return groups


class PersonError(StationError):
    """No body is made of what was given."""


class WrongTrials(PersonError):
    """The command names files that are not the trials of one person."""

    exit_code = WRONG_USAGE


def refuse(code: Code, **figures: float | str) -> PersonError:
    return PersonError(Message(code, figures))


def tendon_finding(change: TendonChange) -> Finding:
    shortest, longest = change.before
    figures: Figures = {
        "muscle": change.muscle,
        "change_mm": 1e3 * change.change,
        "shortest": shortest,
        "longest": longest,
    }
    return Message(PersonCode.TENDON_CHANGED, figures)


def lock_findings(model: Model) -> list[Finding]:
    locks = [c.coordinate for c in model.constraints if isinstance(c, CoordinateLock)]
    names = ", ".join(model.coordinate_names[lock] for lock in locks)
    return [Message(PersonCode.LOCKS_REMOVED, {"coordinates": names})] if locks else []


def mass_findings(model: Model) -> list[Finding]:
    """Segments of a model whose mass is unusual beside that of its upper arm."""
    codes = {HAND: PersonCode.HAND_MASS}
    return [
        Message(codes.get(segment, PersonCode.SEGMENT_MASS), {"segment": segment, "ratio": ratio})
        for segment, ratio in mass_ratios(model).items()
    ]


def ensure_model_mass_fits(model: Model, total: float) -> None:
    """Raises PersonError where a model of a given total mass [kg] has an upper arm as no person of its length."""
    masses = segment_masses(model)
    if UPPER_ARM not in masses:
        return
    fraction = ARM_SEGMENTS[UPPER_ARM].mass_fraction
    lowest, highest = (fraction * mass for mass in usual_masses(upper_arm_length(model)))
    if not lowest <= masses[UPPER_ARM] <= highest:
        figures = {"mass_kg": total, "segment_kg": masses[UPPER_ARM], "lowest_kg": lowest, "highest_kg": highest}
        raise refuse(PersonCode.MODEL_MASS_DOES_NOT_FIT, **figures)


def pose_findings(labels: Sequence[str], observed: Array) -> list[Finding]:
    """Of a static pose (frames, labels, 3) [m]. Raises PersonError where the person moves."""
    label, moved = largest_motion(labels, observed)
    figures: Figures = {"marker": label, "range_mm": 1e3 * moved, "highest_mm": 1e3 * MOVING}
    if moved > MOVING:
        raise PersonError(Message(PersonCode.POSE_MOVES, figures))
    return [Message(PersonCode.POSE_SWAYS, figures)] if moved > SWAYING else []


def ensure_mass_fits(body_mass: float, upper_arm: float) -> None:
    """Raises PersonError for a body mass [kg] that does not occur with an upper arm of this length [m]."""
    lowest, highest = usual_masses(upper_arm)
    if not lowest <= body_mass <= highest:
        figures = {"mass_kg": body_mass, "upper_arm_m": upper_arm, "lowest_kg": lowest, "highest_kg": highest}
        raise refuse(PersonCode.MASS_DOES_NOT_FIT, **figures)


def joint_force_findings(trial: str, force: Array, body_mass: float) -> list[Finding]:
    """Of the joint force (frames,) [N] of a trial, empty where it was not evaluated; body_mass in kg."""
    weights = float(np.nanmax(force, initial=0.0)) / (g * body_mass)
    if weights <= MOST_BODY_WEIGHTS:
        return []
    figures: Figures = {"trial": trial, "percent": 100 * weights, "highest_percent": 100 * MOST_BODY_WEIGHTS}
    return [Message(PersonCode.LARGE_JOINT_FORCE, figures)]


def estimate_findings(estimate: BodyEstimate, trials: Sequence[str]) -> list[Finding]:
    """Convergence, frames, markers far from their places, and postures."""
    found: list[Finding] = []
    if estimate.outcome is not EstimateOutcome.CONVERGED:
        found.append(Message(PersonCode.NOT_CONVERGED, {"steps": estimate.steps}))
    for trial, solution in zip(trials, estimate.postures, strict=True):
        found += _posture_findings(estimate.model, trial, solution)
    deviations = np.linalg.norm(estimate.offsets / estimate.priors.errors.offset[:, None], axis=1)
    for marker, offset, deviation in zip(estimate.tasks.markers, estimate.offsets, deviations, strict=True):
        if deviation > MOST_DEVIATIONS:
            far = 1e3 * float(np.linalg.norm(offset))
            found.append(
                Message(
                    PersonCode.MARKER_FAR_OFF, {"marker": marker.name, "offset_mm": far, "deviations": float(deviation)}
                )
            )
    return found


def _posture_findings(model: Model, trial: str, solution: InverseKinematics) -> list[Finding]:
    found: list[Finding] = []
    if solution.unsolved:
        figures: dict[str, float | str] = {"trial": trial, "frames": solution.unsolved, "all": len(solution.outcomes)}
        found.append(Message(PersonCode.UNSOLVED_FRAMES, figures))
    with np.errstate(invalid="ignore"):
        medians = np.nanmedian(solution.coordinates, axis=0)
    for coordinate, value in zip(model.coordinates, medians, strict=True):
        lowest, highest = coordinate.range
        is_angle = coordinate.motion == "rotation"
        if is_angle and not lowest - BEYOND_RANGE <= value <= highest + BEYOND_RANGE:
            figures = {"trial": trial, "coordinate": coordinate.name, "value_deg": float(np.degrees(value))}
            figures |= {"lowest_deg": float(np.degrees(lowest)), "highest_deg": float(np.degrees(highest))}
            found.append(Message(PersonCode.COORDINATE_OUT_OF_RANGE, figures))
    return found
