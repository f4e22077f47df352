"""What held loads say beside the straight line: drift of the zero, creep, tangent stiffness, energy of a cycle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fitting.outcome import worst
from fitting.plain import plain_estimate
from fitting.results.codes import NoteCode
from fitting.results.note import Note
from fitting.spatial.reduction import ReducedTrial
from fitting.static.creep import Creep, HeldTrial, fit_creep
from fitting.static.migration import is_unloaded
from fitting.static.plateaus import SETTLING, Plateau
from fitting.static.stiffness import StaticFit, StiffnessFit, fit_stiffness
from fitting.uncertainty import Estimate, normal_estimate

SIGNIFICANCE = 3.0
DRIFT_NOTE = 1.0 / 60
"""Newtons a second."""
TANGENTS = 5


@dataclass(frozen=True)
class HeldLoads:
    """Of one donning, None where its protocol cannot tell.

    hold     s after a step at which a load's displacement is read, on average: k is the stiffness after so long
    drift    N/s of the cell's zero while a trial lasts, from the loads before and after; taken out if significant
    creep    of the cuff under held loads
    energy   J that the cuff takes, slipping, creeping and rubbing, while the weights go on and off once
    steps    file → times [s] at which the load was found to change, as protocol.toml would give them
    """

    hold: float
    drift: Estimate | None
    creep: Creep | None
    energy: Estimate | None
    steps: dict[str, tuple[float, ...]]


def fit_held_loads(static: Sequence[ReducedTrial], gain_sd: float) -> tuple[StiffnessFit, HeldLoads | None]:
    """The stiffness from the static trials of a donning, in time order, and what else they say."""
    drift = _drift([each.plateaus for each in static])
    drifts = drift is not None and abs(drift.value) > SIGNIFICANCE * drift.standard_error
    rate = drift.value if drift is not None and drifts else 0.0
    trials = [_without_drift(each.plateaus, rate) for each in static]
    drift_sd = drift.standard_error if drift is not None and drifts else 0.0
    stiffness = fit_stiffness(trials, gain_sd, drift_sd)
    # A cuff whose holds creep explains to the last has not slipped, though its loads lie on no line.
    creep = _creep(static, [replace(fit, segment=0 * fit.segment) for fit in stiffness.trials])
    if creep is not None and creep.is_measured:
        stiffness = fit_stiffness(trials, gain_sd, drift_sd, creeps=True)
    else:
        creep = _creep(static, stiffness.trials)
    if creep is not None:
        stiffness = replace(stiffness, outcome=worst((stiffness.outcome, creep.outcome)))
    if not any(trials):
        return stiffness, None
    spans = [plateau.end - plateau.start for plateaus in trials for plateau in plateaus]
    steps = {each.trial.file: tuple(_step_times(each.plateaus)) for each in static}
    return stiffness, HeldLoads(float(np.mean(spans)) / 2 + SETTLING, drift, creep, _energy(trials), steps)


def held_load_notes(held: HeldLoads | None, stiffness: StiffnessFit) -> tuple[Note, ...]:
    """What a reader should know."""
    if held is None:
        return ()
    notes = []
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
    law = stiffness.law
    if law is not None and abs(law.significance) > SIGNIFICANCE:
        low, high = law.tangent(law.reference_force), law.tangent(_highest(stiffness))
        code = NoteCode.STIFFENS if law.growth > 0 else NoteCode.SOFTENS
        notes.append(Note(code, {"lowest_n_per_m": low.value, "highest_n_per_m": high.value}))
    if held.drift is not None and abs(held.drift.value) > max(SIGNIFICANCE * held.drift.standard_error, DRIFT_NOTE):
        notes.append(Note(NoteCode.ZERO_DRIFT, {"drift_n_per_s": held.drift.value}))
    return tuple(notes)


def plain_held_loads(held: HeldLoads | None, stiffness: StiffnessFit) -> dict[str, Any]:
    """For cuffs.json."""
    if held is None:
        return {}
    law, creep = stiffness.law, held.creep
    plain: dict[str, Any] = {
        "hold_s": held.hold,
        "zero_drift_n_per_s": plain_estimate(held.drift),
        "hysteresis_energy_j": plain_estimate(held.energy),
        "slip_m": stiffness.slip,
        "steps_s": {file: list(times) for file, times in held.steps.items()},
    }
    if creep is not None:
        plain["creep"] = {
            "is_seen": creep.is_seen,
            "fraction": plain_estimate(creep.fraction if creep.explains else None),
            "time_constant_s": creep.time_constant if creep.explains else None,
            "stiffness_at_rest_n_per_m": plain_estimate(creep.stiffness_at_rest if creep.explains else None),
        }
    if law is not None:
        loads = np.linspace(law.reference_force, _highest(stiffness), TANGENTS).tolist()
        plain["exponential_law"] = {
            "stiffening_per_m": plain_estimate(law.stiffening),
            "tangents": [{"force_n": load, "stiffness_n_per_m": plain_estimate(law.tangent(load))} for load in loads],
        }
    return plain


def _drift(trials: Sequence[Sequence[Plateau]]) -> Estimate | None:
    """From trials that start and end unloaded: under the same hook the cell must read the same."""
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
    """Loads as the cell would read them had its zero stayed where it was in the first hold."""
    if not plateaus or rate == 0:
        return tuple(plateaus)
    first = (plateaus[0].start + plateaus[0].end) / 2
    return tuple(
        replace(plateau, force=plateau.force - rate * ((plateau.start + plateau.end) / 2 - first))
        for plateau in plateaus
    )


def _creep(static: Sequence[ReducedTrial], fits: Sequence[StaticFit]) -> Creep | None:
    return fit_creep(
        [
            HeldTrial(
                each.trial.force_time,
                each.trial.force,
                each.trial.marker_time,
                each.displacement,
                fit.plateaus,
                fit.segment,
            )
            for each, fit in zip(static, fits, strict=True)
        ]
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
    """The gradient's one-sided ends count half in a trapezoid's sum."""
    return np.array([0.5, *np.ones(count - 2), 0.5])


def _step_times(plateaus: Sequence[Plateau]) -> list[float]:
    return [round(plateau.start - SETTLING, 2) for plateau in plateaus[1:]]


def _highest(stiffness: StiffnessFit) -> float:
    return max(plateau.force for fit in stiffness.trials for plateau in fit.plateaus)
