"""Decide which quantities of a donning are identified: figures, verdicts, and notes on them, from the fitted pulls."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from documents.message import Figures
from documents.results import EqualByFields
from fitting.dynamic.damping import DampingFit, Swings
from fitting.pull.plateaus import MIN_HOLD, Plateau, last_step
from fitting.pull.pull import Pull, newest_first, of_test
from fitting.results.codes import EXPLAINED_BY, FitOutcome, NoteCode, Verdict, worst
from fitting.results.sentences import Note
from fitting.results.trial_codes import TrialNoteCode
from fitting.static.held_loads import Creep, HeldLoads, fit_migration, held_load_notes
from fitting.static.stiffness import StaticFit, StiffnessFit
from fitting.trial.bounce import Oscillation
from fitting.trial.timeline import REST
from fitting.trial.trial import RejectedTrial, Trial, data_origins
from fitting.uncertainty import Estimate, combine
from recordings.manifest import DataOrigin
from recordings.standard_gravity import g


@dataclass(frozen=True, eq=False)
class FittedPull(EqualByFields):
    """A pull with its fits: the arrays behind the figures of a trial.

    static   held loads and their lines (stiffness of the donning, an offset per segment), None for a dynamic trial
    dynamic  fitted motion and damper force over velocity, None for a static trial
    """

    pull: Pull
    static: StaticFit | None = None
    dynamic: DampingFit | None = None

    def __repr__(self) -> str:
        fits = [name for name in ("static", "dynamic") if getattr(self, name) is not None]
        return f"FittedPull of {self.pull.trial!r}, with the fields pull, {', '.join(fits)}"

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """The held loads, without the drift of the cell's zero; empty for a dynamic trial."""
        return self.static.plateaus if self.static else ()

    @property
    def oscillation(self) -> Oscillation | None:
        """The stretch of a dynamic trial that was fitted."""
        return self.dynamic.oscillation if self.dynamic else None


def fitted_pulls(
    pulls: Sequence[Pull], static: Sequence[Pull], held: HeldLoads, swings: Swings
) -> dict[str, FittedPull]:
    """File → pull and fits, in the order of pulls; static are those that were fitted as held loads."""
    lines = dict(zip([pull.trial.file for pull in static], held.stiffness.trials, strict=True))
    return {
        file: FittedPull(pull, lines.get(file), swings.by_file.get(file))
        for pull in pulls
        if (file := pull.trial.file) in lines or file in swings.by_file
    }


def used_pulls(fitted: Mapping[str, FittedPull], pulls: Sequence[Pull]) -> dict[str, Pull]:
    """File → used pull: the fitted ones, and along other lines the newest run of each repeat."""
    newest = [runs[0] for test in ("static", "dynamic") for runs in newest_first(of_test(pulls, test))]
    others = {pull.trial.file: pull for pull in newest if pull.is_along_another_line}
    return {file: fit.pull for file, fit in fitted.items()} | others


MIN_LOADS = 3
"""Held loads without which a donning has no stiffness."""
WIDE_ANGLE, CLEAR = math.radians(2.5), 0.15
"""Largest uncertainty of the loss angle ωc/k at the swing's frequency due to noise and lag (published cuffs have 2.5 to
20 degrees), unless it is below 15 % of c. With both limits, noise of the estimate of c does not decide on its own."""


@dataclass(frozen=True)
class Identified:
    """The figures of a donning, None if there is none, and the verdicts on them.

    damping is given even if it is not identified: a selection by its value would bias c upward.
    """

    stiffness: Estimate | None
    damping: Estimate | None
    migration: Estimate | None
    verdicts: tuple[Verdict, ...]

    @property
    def estimates(self) -> tuple[Estimate | None, ...]:
        """In the order of CuffParameters' covariance."""
        return self.stiffness, self.damping, self.migration


def identify(
    static: Sequence[Pull],
    all_static: Sequence[Pull],
    held: HeldLoads,
    swings: Swings,
    before: Sequence[str],
    *,
    has_friction: bool = False,
) -> Identified:
    """Figures and verdicts of a donning.

    static are the pulls of the held loads, all_static those of all runs; before lists unreadable static recordings in
    which the cuff may have migrated; has_friction is whether the comparison of laws chose friction.
    """
    stiffness, of_stiffness = _judge_stiffness(static, held.stiffness)
    damping, of_damping = _judge_damping(swings.fits, has_friction=has_friction)
    creep = held.creep if list(static) == list(all_static) else None
    migration, of_migration = _judge_migration(all_static, creep, before)
    verdicts = tuple(verdict for verdict in (of_stiffness, of_damping, of_migration) if verdict)
    return Identified(stiffness, damping, migration, verdicts or (Verdict.IDENTIFIED,))


def started_before(
    static: Sequence[Pull], trials: Sequence[Trial], rejected: Sequence[RejectedTrial], reasons: Mapping[str, Note]
) -> list[str]:
    """Unreadable static recordings earlier than the first static trial, in which the cuff may have migrated."""
    if not static:
        return []
    first = static[0].trial.start_utc_ns
    begun = [(trial.file, trial.test, trial.start_utc_ns) for trial in trials if trial.file in reasons]
    begun += [
        (trial.file, trial.capture.test, trial.capture.start_utc_ns) for trial in rejected if trial.capture is not None
    ]
    return [file for file, test, start in begun if test == "static" and start < first]


def _judge_stiffness(static: Sequence[Pull], fit: StiffnessFit) -> tuple[Estimate | None, Verdict | None]:
    """The stiffness of held loads; None if it is not identified."""
    stiffness = fit.stiffness
    if not static:
        return None, Verdict.NO_STATIC
    if sum(len(pull.plateaus) for pull in static) < MIN_LOADS:
        return None, Verdict.FEW_LOADS
    if stiffness is None:
        return None, Verdict.ONLY_ROSE
    if fit.outcome is not FitOutcome.CONVERGED:
        return None, Verdict.STIFFNESS_NOT_CONVERGED
    # The interval of a reciprocal, or of few loads, is wider than its standard error says.
    if stiffness.is_too_wide or not (stiffness.ci95[1] - stiffness.ci95[0]) / 2 < stiffness.value:
        return None, Verdict.STIFFNESS_UNCERTAIN
    return stiffness, None


def _judge_damping(fits: Sequence[DampingFit], *, has_friction: bool) -> tuple[Estimate | None, Verdict | None]:
    """The damping, even if it is not identified: a selection by its value would bias c upward."""
    if not fits:
        return None, Verdict.NO_DYNAMIC
    damping = combine([fit.damping for fit in fits])
    if worst((damping.outcome, *(fit.outcome for fit in fits))) is not FitOutcome.CONVERGED:
        return damping, Verdict.DAMPING_NOT_CONVERGED
    if has_friction:  # it dissipates, too, and c includes that
        return damping, Verdict.FRICTION
    noise = float(np.linalg.norm([fit.noise for fit in fits])) / len(fits)
    with_lag = math.hypot(
        float(np.linalg.norm([fit.damping.noise for fit in fits])) / len(fits), max(fit.damping.common for fit in fits)
    )
    omega = 2 * math.pi * float(np.mean([fit.oscillation.frequency for fit in fits]))
    angle = omega * with_lag / float(np.mean([fit.stiffness.value for fit in fits]))
    is_wide = angle > WIDE_ANGLE and with_lag > CLEAR * abs(damping.value)
    if not damping.is_too_wide and not is_wide:
        return damping, None if damping.value > 0 else Verdict.NEGATIVE
    return damping, Verdict.LAG if with_lag > math.sqrt(2) * noise else Verdict.DAMPING_UNCERTAIN


def _judge_migration(
    static: Sequence[Pull], creep: Creep | None, before: Sequence[str]
) -> tuple[Estimate | None, Verdict | None]:
    """The migration; before lists unreadable static recordings in which the cuff may have migrated."""
    migration = fit_migration([pull.plateaus for pull in static], creep)
    if migration is None:
        return None, Verdict.NOT_UNLOADED if static else None
    return (None, Verdict.MIGRATED_BEFORE) if before else (migration, None)


LARGEST_RATIO = 2.0
"""Of the stiffnesses of a cuff along orthogonal axes: 2.1 to 4.2 N/mm at the upper arm, means of 21 people (Schiebl et
al. 2025, Sensors 25:4605, linear regression of the group; 2.3 to 4.6 N/mm as means of single regressions)."""
MOST_OBLIQUE = (LARGEST_RATIO + 1) / (2 * math.sqrt(LARGEST_RATIO))
"""Largest inverse cosine of the angle between a force and its displacement (Kantorovich's inequality)."""


def shows_rope(pulls: Sequence[Pull]) -> bool:
    """Whether markers on the rope show the direction of at least one of the pulls."""
    return any(pull.motion.rope is not None for pull in pulls)


def along_unknown_rope(estimate: Estimate | None) -> Estimate | None:
    """Stiffness or damping along a rope whose direction is unknown, from the displacement along itself.

    Displacement d and force F alone do not determine the direction: for every unit vector u with u·d > 0 there is a
    symmetric positive definite K with K d = F u. Along u it is larger by the inverse cosine of the angle to d. Every
    angle that LARGEST_RATIO permits is possible, so that the interval extends to the largest value.
    """
    if estimate is None:
        return None
    most = estimate.scaled(MOST_OBLIQUE)
    part = abs(most.value - estimate.value) / math.sqrt(3)
    return replace(
        estimate,
        standard_error=math.hypot(estimate.standard_error, part),
        ci95=(min(estimate.ci95[0], most.ci95[0]), max(estimate.ci95[1], most.ci95[1])),
        parts={**estimate.parts, "direction": part},
    )


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
    unidentified = {name for verdict in identified.verdicts for name in verdict.quantities}
    return (
        *_stopped_notes(all_static, trials, swings, identified.verdicts),
        *_stiffness_notes(held.stiffness, swings.fits),
        *interval_notes(None if "damping" in unidentified else identified.damping),
        *migration_interval_notes(identified.migration),
        *held_load_notes(held),
        *_direction_notes(all_static),
        *_origin_notes(trials, set(data_origins(trials))),
        *_calibration_notes(trials),
        *_migration_notes(all_static, before),
    )


SHORT_SWING = 0.8
"""Part of the planned duration; the fit leaves out some of the begin and the end of a whole swing."""


def _stopped_notes(
    static: Sequence[Pull], trials: Sequence[Trial], swings: Swings, verdicts: Sequence[Verdict]
) -> Iterator[Note]:
    """Notes on trials in which loads or a swing are missing, if these explain a verdict.

    A trial of which only a window is used has none.
    """
    notes = [_stopped_static(pull) for pull in static]
    notes += [_stopped_swing(trial, swings.by_file.get(trial.file)) for trial in trials if trial.test == "dynamic"]
    for note in filter(None, notes):
        if set(EXPLAINED_BY[note.code]) & set(verdicts):
            yield note


def _stopped_static(pull: Pull) -> Note | None:
    trial = pull.trial
    planned, step = len(trial.step_masses), last_step(pull.plateaus, trial.step_masses)
    if not planned or step is None or _is_window(trial):
        return None
    added, removed = step
    figures: Figures = {"file": trial.file, "repeat": trial.repeat, "total": planned}
    stopped = NoteCode.STOPPED_LOADING if added < planned else NoteCode.STOPPED_UNLOADING
    count = added if added < planned else removed
    if count == planned:
        return None
    code = NoteCode.HIDDEN_LOADS if _misses_load(pull, g * trial.step_masses[min(added, planned - 1)]) else stopped
    return Note(code, {**figures, "count": count})


def _misses_load(pull: Pull, weight: float) -> bool:
    """Whether force or markers end as much as a hold before the capture, or the cuff is hidden for as long while the
    force is above all held loads by half a weight [N]. Without a held load it is compared with the force at rest.
    """
    if _ends_early(pull.trial):
        return True
    hidden = pull.marker_time[np.isnan(pull.displacement)]
    at_rest = float(np.mean(pull.force[pull.force_time < pull.force_time[0] + REST]))
    highest = max((plateau.force for plateau in pull.plateaus), default=at_rest)
    is_above = np.interp(hidden, pull.force_time, pull.force) > highest + weight / 2
    return bool(np.count_nonzero(is_above) * float(np.median(np.diff(pull.marker_time))) > MIN_HOLD)


def _ends_early(trial: Trial) -> bool:
    """Whether force or markers end as much as a hold before the capture."""
    return trial.capture_end is not None and trial.capture_end - trial.end > MIN_HOLD


def _stopped_swing(trial: Trial, fit: DampingFit | None) -> Note | None:
    """fit is None for a trial that swings for too short a time to be fitted."""
    start, end = (fit.oscillation.start, fit.oscillation.end) if fit else (trial.force_time[0], trial.force_time[-1])
    swung, planned = float(end - start), trial.swing_duration
    if planned is None or swung >= SHORT_SWING * planned or _is_window(trial):
        return None
    figures: Figures = {"file": trial.file, "repeat": trial.repeat, "found_s": swung, "planned_s": planned}
    return Note(NoteCode.SWING_CUT if _ends_early(trial) else NoteCode.STOPPED_SWINGING, figures)


def _is_window(trial: Trial) -> bool:
    return any(note.code is TrialNoteCode.WINDOW for note in trial.notes)


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
    figures: Figures = {"ratio": LARGEST_RATIO, "more": MOST_OBLIQUE - 1}
    return (Note(NoteCode.NO_ROPE, figures),) if static and not shows_rope(static) else ()


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
