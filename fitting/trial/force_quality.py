"""Quality of the force: invalid samples, lost samples, drift of the zero."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Figures, Note

REST = 1.0
"""Seconds at both ends of a trial in which the force may be at rest."""
ZERO_DRIFT, ZERO_DRIFT_PART = 0.5, 0.02
"""Drift of the zero without a note: the larger of newtons and part of the trial's range."""


def damage_figures(damage: tuple[str, ...]) -> Figures:
    """Figures of the codes DAMAGED. Damage is the only note on a damaged file, or the only reason to reject it."""
    more: Figures = {"more": len(damage) - 1} if len(damage) > 1 else {}
    return {"damage": damage[0], **more}


def require_labels(wanted: tuple[str, ...], present: tuple[str, ...]) -> None:
    """Raise UnusableTrial with the names of the wanted markers that the recording lacks."""
    missing = [label for label in wanted if label not in present]
    if missing:
        figures = {"missing": ", ".join(missing), "present": ", ".join(present) or "none"}
        raise UnusableTrial(RejectionCode.MISSING_MARKERS, figures)


def require_sound_force(values: NDArray[np.float64], limit: float, unit: str = "V") -> None:
    """Raise UnusableTrial for invalid, saturated or constant force samples (n,), in the device's unit.

    limit is the largest valid reading, inf if unknown.
    """
    total = len(values)
    broken = int(np.count_nonzero(~np.isfinite(values)))
    if broken:
        raise UnusableTrial(RejectionCode.FORCE_NOT_FINITE, {"count": broken, "total": total})
    saturated = int(np.count_nonzero(np.abs(values) >= 0.99 * limit))
    if saturated > 3:  # one or two samples at full scale are an electrical spike, not a load
        figures: Figures = {"count": saturated, "total": total, "limit": limit, "unit": unit}
        raise UnusableTrial(RejectionCode.FORCE_SATURATED, figures)
    if total and np.all(values == values[0]):
        raise UnusableTrial(RejectionCode.FORCE_CONSTANT, {"value": float(values[0]), "total": total})


def loss_notes(
    force_gaps: tuple[tuple[float, float], ...], frame_gaps: tuple[tuple[float, float], ...]
) -> tuple[Note, ...]:
    """A note for each stream that lost samples: gaps are (start, end) [s]."""
    notes = []
    for code, gaps in ((TrialNoteCode.FORCE_LOST, force_gaps), (TrialNoteCode.FRAMES_LOST, frame_gaps)):
        if gaps:
            lost = [end - start for start, end in gaps]
            notes.append(Note(code, {"count": len(gaps), "total_s": sum(lost), "longest_s": max(lost)}))
    return tuple(notes)


def zero_drift(time: NDArray[np.float64], force: NDArray[np.float64]) -> float | None:
    """Force (n,) [N] at rest at the end of a trial minus that at its start; None without unloaded rest at both.

    The force is at rest if the halves of a second differ by less than 2 % of its range, in the lowest quarter of it.
    """
    ends = [force[time < time[0] + REST], force[time > time[-1] - REST]]
    halves = [[float(np.mean(half)) for half in np.array_split(end, 2)] for end in ends if len(end) >= 2]
    low, high = float(force.min()), float(force.max())
    is_rest = [max(pair) < low + (high - low) / 4 and abs(pair[1] - pair[0]) < (high - low) / 50 for pair in halves]
    if len(is_rest) < 2 or not all(is_rest):
        return None
    return sum(halves[1]) / 2 - sum(halves[0]) / 2


def require_steady_zero(drift: float | None, limit: float) -> None:
    """Raise UnusableTrial if the drift of the zero [N] exceeds the limit [N]."""
    if drift is not None and abs(drift) > limit:
        raise UnusableTrial(RejectionCode.ZERO_DRIFT, {"drift_n": drift, "limit_n": limit})


def zero_notes(drift: float | None, span: float) -> tuple[Note, ...]:
    """A note if the drift of the zero [N] is large for a force with this range [N]."""
    limit = max(ZERO_DRIFT, ZERO_DRIFT_PART * span)
    if drift is None or abs(drift) <= limit:
        return ()
    return (Note(TrialNoteCode.ZERO_DRIFT, {"drift_n": drift, "limit_n": limit}),)
