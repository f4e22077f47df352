"""Notes on a trial's two sync edges."""

from __future__ import annotations

from fitting.results.codes import TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.clock_fit import ClockFit
from fitting.trial.clocks import CRYSTAL_LIMIT, LARGEST_DRIFT


def early_notes(early: float) -> tuple[Note, ...]:
    """A note if the sync line rose `early` [s] before the first frame was exposed."""
    return (Note(TrialNoteCode.SYNC_BEFORE_FRAMES, {"early_s": early}),) if early else ()


def stop_notes(falling: float | None, clock: ClockFit, contradiction: float) -> tuple[Note, ...]:
    """A note if the stop edge does not determine the clock ratio, or contradicts the number of frames [s]."""
    if falling is None:
        return ()
    if contradiction:
        name = "before_end_s" if contradiction < 0 else "between_frames_s"
        return (Note(TrialNoteCode.SYNC_CONTRADICTION, {name: abs(contradiction), "limit": LARGEST_DRIFT}),)
    if not clock.has_both_edges:
        return (Note(TrialNoteCode.SYNC_MISSING_FRAMES),)
    if clock.missing_frames:
        figures = {"limit": CRYSTAL_LIMIT, "frames": clock.missing_frames}
        return (Note(TrialNoteCode.CLOCKS_OR_FRAMES, figures),)
    if not clock.is_identified:
        return (Note(TrialNoteCode.CLOCKS_OPEN, {"limit": LARGEST_DRIFT}),)
    return ()
