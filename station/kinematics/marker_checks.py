"""Do markers go with the model? Refusals before anything is solved, findings on what was solved.

A file with markers on a body is read as a table under the names of the model's markers.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from recordings.exchange.c3d import read_c3d_markers
from recordings.exchange.qtm_tsv import read_qtm_tsv
from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc
from solver.inverse_kinematics.exchanges import Exchange, find_exchanges
from solver.inverse_kinematics.marker_fit import fit_markers
from solver.inverse_kinematics.posture_uncertainty import PostureUncertainty
from solver.inverse_kinematics.solve import InverseKinematics, PostureOutcome, TrackingTasks
from solver.model import Marker, Model
from solver.osim.tool_setups import IkSetup, ScaleSetup
from station.errors import StationError
from station.messages.codes import KinematicsCode
from station.messages.message import Figures, Message

Array = NDArray[np.float64]
Finding = Message[StrEnum]

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


def setup_findings(file: str, setup: IkSetup | ScaleSetup, unknown: Collection[str]) -> tuple[Finding, ...]:
    """Findings on a set-up: elements that are not used, files that are elsewhere, and the names that are unknown."""
    found = {
        KinematicsCode.UNUSED_ELEMENTS: ("elements", setup.unused),
        KinematicsCode.FILE_ELSEWHERE: ("files", setup.moved),
        KinematicsCode.NOT_IN_MODEL: ("names", unknown),
    }
    return tuple(Message(code, {"file": file, key: ", ".join(names)}) for code, (key, names) in found.items() if names)


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
    """Those of which observed (frames, markers, 3) has a position in some frame."""
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
            found.append(Message[StrEnum](KinematicsCode.FAR, figures))
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


UNSOLVED = {
    PostureOutcome.NOT_CONVERGED: KinematicsCode.NOT_CONVERGED,
    PostureOutcome.GAP_OPEN: KinematicsCode.GAP_OPEN,
    PostureOutcome.NO_MARKERS: KinematicsCode.NO_MARKERS,
}


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
