"""Results of the held loads: stiffness, drift of the zero, creep, tangent stiffness, energy of a cycle."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from documents.results import EqualByFields
from fitting.pull.plateaus import Plateau, is_unloaded
from fitting.pull.pull import Pull
from fitting.results.codes import NoteCode
from fitting.results.outcome import worst
from fitting.results.rendering import Note
from fitting.static.creep import Creep, fit_creep
from fitting.static.stiffness import StiffnessFit, fit_stiffness
from fitting.uncertainty import Estimate, normal_estimate

SIGNIFICANCE = 3.0
DRIFT_NOTE = 1.0 / 60
"""Drift of the zero [N/s] from which it is reported."""
TANGENTS = 5
LEAST_HOLD = 4.0
"""Seconds of a hold that suffice for a cuff to rest and for the noise of its mean."""


@dataclass(frozen=True, eq=False)
class HeldLoads(EqualByFields):
    """Results of the static trials of one donning; None if their protocol does not determine a quantity.

    stiffness  k, slip and friction
    hold       s after a step at which the displacement is read, on average: k is the stiffness after this time
    drift      N/s of the cell's zero, from the bare hook before and after a trial; removed if significant
    creep      of the cuff under held loads
    energy     J dissipated by slip, creep and friction in one cycle of loading and unloading
    steps      file → times [s] of the detected steps of the load, as in protocol.toml
    duration   s of a hold, the median; infinite without a step
    """

    stiffness: StiffnessFit
    hold: float = 0.0
    drift: Estimate | None = None
    creep: Creep | None = None
    energy: Estimate | None = None
    steps: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    duration: float = math.inf

    @property
    def has_loads(self) -> bool:
        """Whether any load was held."""
        return any(fit.plateaus for fit in self.stiffness.trials)

    @property
    def highest(self) -> float:
        """The highest held load [N]."""
        return max(plateau.force for fit in self.stiffness.trials for plateau in fit.plateaus)

    @property
    def tangents(self) -> tuple[tuple[float, Estimate], ...]:
        """Loads [N] above the lowest held one, that of the bare hook, with their tangent stiffness [N/m].

        Not readings, as the cell's zero is not removed from those. Empty without a law.
        """
        law = self.stiffness.law
        if law is None:
            return ()
        loads = np.linspace(0.0, self.highest - law.reference_force, TANGENTS).tolist()
        return tuple((load, law.tangent(law.reference_force + load)) for load in loads)


def fit_held_loads(static: Sequence[Pull], gain_sd: float) -> HeldLoads:
    """Stiffness, drift, creep and energy from the static trials of a donning in time order."""
    drift = _drift([pull.plateaus for pull in static])
    is_drifting = drift is not None and abs(drift.value) > SIGNIFICANCE * drift.standard_error
    rate = drift.value if drift is not None and is_drifting else 0.0
    trials = [_without_drift(pull.plateaus, rate) for pull in static]
    drift_sd = drift.standard_error if drift is not None and is_drifting else 0.0
    stiffness = fit_stiffness(trials, gain_sd, drift_sd)
    # If creep explains the holds, the cuff has not slipped, although the loads are not on a line.
    creep = fit_creep(static, [replace(fit, segment=0 * fit.segment) for fit in stiffness.trials])
    if creep is not None and creep.is_measured:
        stiffness = fit_stiffness(trials, gain_sd, drift_sd, creeps=True)
    else:
        creep = fit_creep(static, stiffness.trials)
    if creep is not None:
        stiffness = replace(stiffness, outcome=worst((stiffness.outcome, creep.outcome)))
    if not any(trials):
        return HeldLoads(stiffness)
    after_step = [
        (plateau.hold, (plateau.start + plateau.end) / 2 - plateau.step)
        for plateaus in trials
        for plateau in plateaus
        if plateau.step is not None
    ]
    durations, read_after = np.array(after_step).reshape(-1, 2).T
    steps = {pull.trial.file: tuple(round(p.step, 2) for p in pull.plateaus if p.step is not None) for pull in static}
    return HeldLoads(
        stiffness,
        float(np.mean(read_after)) if after_step else 0.0,
        drift,
        creep,
        _energy(trials),
        steps,
        float(np.median(durations)) if after_step else math.inf,
    )


def held_load_notes(held: HeldLoads) -> tuple[Note, ...]:
    """Notes on the held loads."""
    if not held.has_loads:
        return ()
    notes = [Note(NoteCode.SHORT_HOLDS, {"hold_s": held.duration})] if held.duration < LEAST_HOLD else []
    if held.creep is not None and held.creep.is_measured:
        rest, fraction = held.creep.stiffness_at_rest, held.creep.fraction
        figures = {
            "fraction": fraction.value,
            "fraction_half_width": 1.96 * fraction.standard_error,
            "time_constant_s": held.creep.time_constant,
            "hold_s": held.hold,
            "rest_n_per_m": rest.value,
            "rest_half_width_n_per_m": 1.96 * rest.standard_error,
        }
        notes.append(Note(NoteCode.CREEPS, figures))
    elif held.creep is not None and held.creep.is_seen:
        notes.append(Note(NoteCode.YIELDS, {"hold_s": held.hold}))
    law = held.stiffness.law
    if law is not None and abs(law.significance) > SIGNIFICANCE:
        low, high = law.tangent(law.reference_force), law.tangent(held.highest)
        code = NoteCode.STIFFENS if law.growth > 0 else NoteCode.SOFTENS
        notes.append(Note(code, {"lowest_n_per_m": low.value, "highest_n_per_m": high.value}))
    if held.drift is not None and abs(held.drift.value) > max(SIGNIFICANCE * held.drift.standard_error, DRIFT_NOTE):
        notes.append(Note(NoteCode.ZERO_DRIFT, {"drift_n_per_s": held.drift.value}))
    return tuple(notes)


def _drift(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """Drift of the zero [N/s] from trials that start and end with the bare hook."""
    found = []
    for plateaus in trials:
        if len(plateaus) < 3 or not is_unloaded(plateaus[0], plateaus) or not is_unloaded(plateaus[-1], plateaus):
            continue
        span = (plateaus[-1].start + plateaus[-1].end - plateaus[0].start - plateaus[0].end) / 2
        sd = math.hypot(plateaus[0].force_sd, plateaus[-1].force_sd)
        found.append(((plateaus[-1].force - plateaus[0].force) / span, sd / span))
    if not found:
        return None
    rates, sds = np.array(found).T
    weights = sds**-2.0
    mean = float(weights @ rates / weights.sum())
    spread = float(np.std(rates, ddof=1)) / math.sqrt(len(rates)) if len(rates) > 1 else 0.0
    return normal_estimate(mean, max(float(weights.sum() ** -0.5), spread))


def _without_drift(plateaus: Sequence[Plateau], rate: float) -> tuple[Plateau, ...]:
    """The plateaus with forces corrected for the drift since the first hold."""
    if not plateaus or rate == 0:
        return tuple(plateaus)
    first = (plateaus[0].start + plateaus[0].end) / 2
    return tuple(
        replace(plateau, force=plateau.force - rate * ((plateau.start + plateau.end) / 2 - first))
        for plateau in plateaus
    )


def _energy(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """∮ F dx of the plateaus above the hook's load, averaged over the trials that start and end unloaded."""
    works = []
    for plateaus in trials:
        if len(plateaus) < 3 or not is_unloaded(plateaus[0], plateaus) or not is_unloaded(plateaus[-1], plateaus):
            continue
        force = np.array([plateau.force for plateau in plateaus]) - plateaus[0].force
        x = np.array([plateau.displacement for plateau in plateaus])
        by_force, by_x = np.gradient(x) * _ends(len(x)), -np.gradient(force) * _ends(len(x))
        force_sd = np.array([plateau.force_sd for plateau in plateaus])
        x_sd = np.array([plateau.displacement_sd for plateau in plateaus])
        work = float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(x)))
        works.append((work, math.hypot(float(np.linalg.norm(by_force * force_sd)), float(np.linalg.norm(by_x * x_sd)))))
    if not works:
        return None
    values, errors = np.array(works).T
    spread = float(np.std(values, ddof=1)) if len(values) > 1 else 0.0
    error = max(float(np.linalg.norm(errors)) / len(values), spread / math.sqrt(len(values)))
    return normal_estimate(float(values.mean()), error)


def _ends(count: int) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Weights (n,) for np.gradient: in a trapezoidal sum its one-sided ends have half the weight."""
    return np.array([0.5, *np.ones(count - 2), 0.5])
