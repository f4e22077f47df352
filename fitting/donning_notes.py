"""What a reader should know of a donning's figures."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitting.dynamic.damping import DampingFit
from fitting.results.codes import NoteCode
from fitting.results.note import Note
from fitting.results.rendering import Figures
from fitting.spatial.reduction import ReducedTrial
from fitting.static.migration import fit_migration
from fitting.static.stiffness import StiffnessFit
from fitting.trial import Trial
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin

SAME_STIFFNESS = (0.8, 1.25)
"""Dynamic over static stiffness outside of which the difference is noted."""


def donning_notes(stiffness: StiffnessFit, damping: Sequence[DampingFit]) -> tuple[Note, ...]:
    """On the stiffness of the held loads, and on that of the swings beside it."""
    notes = [*_slip_notes(stiffness)]
    if stiffness.only_rose and stiffness.stiffness:
        notes.append(Note(NoteCode.ONLY_ROSE))
    if any(fit.uses_static_stiffness for fit in damping):
        notes.append(Note(NoteCode.STATIC_STIFFNESS_USED))
    if stiffness.stiffness and damping:
        ratio = float(np.mean([fit.stiffness.value for fit in damping])) / stiffness.stiffness.value
        if not SAME_STIFFNESS[0] < ratio < SAME_STIFFNESS[1]:
            notes.append(Note(NoteCode.STIFFNESS_RATIO, {"ratio": ratio}))
    return tuple(notes)


def interval_notes(damping: Estimate | None) -> tuple[Note, ...]:
    """A damping [N s/m] whose standard error is small enough may still have an interval that holds zero."""
    if damping is None or damping.ci95[0] > 0:
        return ()
    low, high = damping.ci95
    return (Note(NoteCode.DAMPING_INTERVAL, {"low_n_s_per_m": low, "high_n_s_per_m": high}),)


def migration_notes(static: Sequence[ReducedTrial], before: Sequence[str]) -> tuple[Note, ...]:
    """Where the cuff may have migrated in recordings before the first usable one."""
    migration = fit_migration([each.plateaus for each in static])
    if not before or migration is None:
        return ()
    figures: Figures = {"file": static[0].trial.file, "migration_m": migration.value, "before": ", ".join(before)}
    return (Note(NoteCode.MIGRATED_BEFORE, figures),)


def origin_notes(trials: Sequence[Trial], origins: set[DataOrigin]) -> tuple[Note, ...]:
    """Where simulated and other recordings were fitted together."""
    simulated = [trial.file for trial in trials if trial.origin is DataOrigin.SIMULATED]
    if not simulated or origins == {DataOrigin.SIMULATED}:
        return ()
    return (Note(NoteCode.MIXED_ORIGIN, {"simulated": ", ".join(simulated)}),)


def _slip_notes(stiffness: StiffnessFit) -> Iterator[Note]:
    """What moves a cuff beside its spring while weights go on and off."""
    if stiffness.slips_again and stiffness.further:
        yield Note(NoteCode.SLIPS_AGAIN, {"distance_m": stiffness.further})
    elif stiffness.slips_again:
        yield Note(NoteCode.RUBS_OR_MOVED)
    if stiffness.if_rubs and stiffness.stiffness:
        figures = {"slipped_n_per_m": stiffness.stiffness.value, "rubs_n_per_m": stiffness.if_rubs.value}
        yield Note(NoteCode.SLIP_OR_FRICTION, figures)
    if stiffness.friction:
        yield Note(NoteCode.RUBS, {"friction_n": stiffness.friction})
