"""Notes on the results of a donning."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitting.diagnosis.identification import Identified
from fitting.dynamic.damping import DampingFit
from fitting.dynamic.swings import Swings
from fitting.pull.pull import Pull
from fitting.results.codes import UNIDENTIFIED_BY, NoteCode
from fitting.results.rendering import Figures, Note
from fitting.static.held_loads import HeldLoads, held_load_notes
from fitting.static.migration import fit_migration
from fitting.static.stiffness import StiffnessFit
from fitting.trial.trial import Trial, origins_of
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin

SAME_STIFFNESS = (0.8, 1.25)
"""Range of the ratio of dynamic to static stiffness that needs no note."""
NO_MIGRATION = 0.5e-3
"""Half width of an interval [m] up to which a migration around zero is known."""


def notes_on(
    trials: Sequence[Trial],
    all_static: Sequence[Pull],
    held: HeldLoads,
    swings: Swings,
    identified: Identified,
    before: Sequence[str],
) -> tuple[Note, ...]:
    """All notes on a donning. before lists unreadable static recordings in which the cuff may have migrated."""
    unidentified = {name for verdict in identified.verdicts for name in UNIDENTIFIED_BY.get(verdict, ())}
    return (
        *_stiffness_notes(held.stiffness, swings.fits),
        *interval_notes(None if "damping" in unidentified else identified.damping),
        *migration_interval_notes(identified.migration),
        *held_load_notes(held),
        *_direction_notes(all_static),
        *_origin_notes(trials, set(origins_of(trials))),
        *_calibration_notes(trials),
        *_migration_notes(all_static, before),
    )


def interval_notes(damping: Estimate | None) -> tuple[Note, ...]:
    """A note if the 95 % interval of the damping [N s/m] includes zero, although its standard error is small enough."""
    if damping is None or damping.ci95[0] > 0:
        return ()
    low, high = damping.ci95
    return (Note(NoteCode.DAMPING_INTERVAL, {"low_n_s_per_m": low, "high_n_s_per_m": high}),)


def migration_interval_notes(migration: Estimate | None) -> tuple[Note, ...]:
    """A note if the interval of the migration [m] is wider than its value, and too wide to be around none."""
    if migration is None:
        return ()
    low, high = migration.ci95
    if (high - low) / 2 <= max(abs(migration.value), NO_MIGRATION):
        return ()
    return (Note(NoteCode.MIGRATION_INTERVAL, {"low_m": low, "high_m": high}),)


def _stiffness_notes(stiffness: StiffnessFit, damping: Sequence[DampingFit]) -> tuple[Note, ...]:
    """Notes on the static stiffness, and on its ratio to the dynamic one."""
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


def _migration_notes(static: Sequence[Pull], before: Sequence[str]) -> tuple[Note, ...]:
    """A note if the cuff may have migrated in recordings before the first usable one."""
    migration = fit_migration([pull.plateaus for pull in static])
    if not before or migration is None:
        return ()
    figures: Figures = {"file": static[0].trial.file, "migration_m": migration.value, "before": ", ".join(before)}
    return (Note(NoteCode.MIGRATED_BEFORE, figures),)


def _direction_notes(static: Sequence[Pull]) -> tuple[Note, ...]:
    """A note if no markers on the rope show the direction of the pull."""
    return (Note(NoteCode.NO_ROPE),) if static and all(pull.motion.rope is None for pull in static) else ()


def _origin_notes(trials: Sequence[Trial], origins: set[DataOrigin]) -> tuple[Note, ...]:
    """A note if simulated and other recordings were fitted together."""
    simulated = [trial.file for trial in trials if trial.origin is DataOrigin.SIMULATED]
    if not simulated or origins == {DataOrigin.SIMULATED}:
        return ()
    return (Note(NoteCode.MIXED_ORIGIN, {"simulated": ", ".join(simulated)}),)


def _calibration_notes(trials: Sequence[Trial]) -> tuple[Note, ...]:
    """A note if no bounce trial calibrates lag and gain, with their declared standard uncertainties."""
    uncalibrated = [trial for trial in trials if trial.calibration is None]
    if not uncalibrated:
        return ()
    lag, gain_sd = uncalibrated[0].lag, max(trial.gain_sd for trial in uncalibrated)
    figures = {"lag_s": lag.value, "lag_sd_s": lag.declared, "gain_sd": gain_sd}
    return (Note(NoteCode.NOT_CALIBRATED, figures),)


def _slip_notes(stiffness: StiffnessFit) -> Iterator[Note]:
    """Notes on slip and friction while weights are added and removed."""
    if stiffness.slips_again and stiffness.progressive_slip:
        yield Note(NoteCode.SLIPS_AGAIN, {"distance_m": stiffness.progressive_slip})
    elif stiffness.slips_again:
        yield Note(NoteCode.FRICTION_OR_MOVED)
    if stiffness.if_friction and stiffness.if_slip:
        figures = {"slipped_n_per_m": stiffness.if_slip.value, "rubs_n_per_m": stiffness.if_friction.value}
        yield Note(NoteCode.SLIP_OR_FRICTION, figures)
    if stiffness.friction:
        yield Note(NoteCode.FRICTION_OR_CREEP, {"friction_n": stiffness.friction})
