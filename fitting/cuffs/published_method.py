"""The published method, equation by equation, for comparison on the same trials, and its bias due to marker noise.

    (1) F = k x + c ẋ
    (2) F = k x            k from the means of the held loads, x from the record's own start, with an intercept as the
                           linear fit of its Fig. 6, and through the origin as the equation
    (3) ẋ = Δx / Δt        central difference from frame to frame
    (4) F − k x = c ẋ      c through the origin, F at the frames, x from the dynamic record's own start
    (5) migration = x at the end − x at the start of a static record

Marker noise s_x per frame gives ẋ the noise s_v = s_x / (√2 Δt), and a slope over a noisy abscissa is attenuated: c is
reduced by the factor S_v / (S_v + s_v²), where S_v is the mean square of the true velocity. The factor is predicted
from the errors-in-variables fit of the same record, and compared with the observed one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.cuffs.cuff_fit import SessionFit
from fitting.diagnosis.identification import FittedPull
from fitting.results.codes import NoteCode
from fitting.results.sentences import Note
from solver.cuff import KelvinVoigt

OWN_START = 1.0
"""Seconds at the start of a record whose mean is its zero."""
NOTED_LOSS = 0.1
"""Part of the damping that noise must take from it to be noted."""


@dataclass(frozen=True)
class PublishedFit:
    """A cuff by equations 1 to 5: means over the repeats, None without such trials.

    stiffness [N/m] with an intercept, damping [N s/m] with this stiffness, migration [m]
    stiffness_through_origin  [N/m]: hook and zero of the cell, which an intercept removes, are in it
    damper_force        mean of F − k x in the dynamic records [N]
    negative_part       share of its samples that are negative
    predicted_attenuation  factor by which differences of noisy frames reduce c, predicted
    observed_attenuation   c here over c of the errors-in-variables fit of the same records
    """

    stiffness: float | None
    stiffness_through_origin: float | None
    damping: float | None
    migration: float | None
    damper_force: float | None
    negative_part: float | None
    predicted_attenuation: float | None
    observed_attenuation: float | None


def published_fits(session: SessionFit) -> dict[str, PublishedFit]:
    """Every cuff as last donned, from the trials that the session's fit used."""
    return {
        name: fit_published([session.pulls[trial.file] for trial in fit.trials if trial.file in session.pulls])
        for name, fit in session.cuffs.items()
    }


def published_json(fits: Mapping[str, PublishedFit]) -> dict[str, dict[str, float | None]]:
    """As plain data, units in the keys."""
    return {
        name: {
            "stiffness_n_per_m": fit.stiffness,
            "stiffness_through_origin_n_per_m": fit.stiffness_through_origin,
            "damping_n_s_per_m": fit.damping,
            "migration_m": fit.migration,
            "mean_damper_force_n": fit.damper_force,
            "negative_part": fit.negative_part,
            "predicted_part_of_damping_left": fit.predicted_attenuation,
            "observed_part_of_damping_left": fit.observed_attenuation,
        }
        for name, fit in fits.items()
    }


def published_notes(trials: Sequence[FittedPull]) -> tuple[Note, ...]:
    """A note on the damping by the published method if marker noise makes it clearly smaller."""
    fit = fit_published(trials)
    if fit.damping is None or fit.observed_attenuation is None or fit.predicted_attenuation is None:
        return ()
    if fit.predicted_attenuation > 1 - NOTED_LOSS:
        return ()
    figures = {
        "damping_n_s_per_m": fit.damping,
        "left": fit.observed_attenuation,
        "predicted": fit.predicted_attenuation,
    }
    return (Note(NoteCode.PUBLISHED_DAMPING, figures),)


def fit_published(trials: Sequence[FittedPull]) -> PublishedFit:
    """The published method on the trials of one donning."""
    static = [(fitted, *_held(fitted)) for fitted in trials if fitted.static and len(fitted.static.plateaus) > 1]
    static = [(fitted, x, force) for fitted, x, force in static if np.ptp(x) > 0]
    slopes = {fitted.pull.trial.repeat: float(np.polyfit(x, force, 1)[0]) for fitted, x, force in static}
    stiffness = _mean(list(slopes.values()))
    through_origin = _mean([float(x @ force / (x @ x)) for _, x, force in static])
    swings = np.empty((0, 5))
    if stiffness is not None:
        of_repeat = [
            (fitted, slopes.get(fitted.pull.trial.repeat, stiffness)) for fitted in trials if fitted.dynamic is not None
        ]
        swings = np.array([_swing(pull, k) for pull, k in of_repeat]).reshape(-1, 5)
    migration = _mean([float(x[-1] - x[0]) for _, x, _ in static])
    damping, *rest = (_mean(column) for column in swings.T)
    return PublishedFit(stiffness, through_origin, damping, migration, *rest)


def _held(fitted: FittedPull) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement from the record's own start and force of the held loads (plateaus,) [m], [N]."""
    plateaus = fitted.static.plateaus if fitted.static else ()
    x = np.array([plateau.displacement for plateau in plateaus]) - _own_zero(fitted)
    return x, np.array([plateau.force for plateau in plateaus])


def _swing(fitted: FittedPull, k: float) -> tuple[float, float, float, float, float]:
    """c, mean of F − k x, its negative share, and the predicted and the observed attenuation of c."""
    fit = fitted.dynamic
    if fit is None:
        raise ValueError("a trial without a fitted swing has no damping")
    pull = fitted.pull
    step = float(np.median(np.diff(pull.marker_time)))
    velocity = (pull.displacement[2:] - pull.displacement[:-2]) / (2 * step)
    time = pull.marker_time[1:-1]
    inside = (time >= fit.oscillation.start) & (time <= fit.oscillation.end) & np.isfinite(velocity)
    inside &= np.isfinite(pull.displacement[1:-1])
    displacement = pull.displacement[1:-1][inside] - _own_zero(fitted)
    v = velocity[inside]
    spring = KelvinVoigt(k).force(displacement, np.zeros_like(v))
    damper_force = np.interp(time[inside], pull.force_time, pull.force) - spring
    c = float(v @ damper_force / (v @ v))
    true, noise = float(np.mean(fit.velocity**2)), fit.marker_noise**2 / (2 * step**2)
    return (
        c,
        float(np.mean(damper_force)),
        float(np.mean(damper_force < 0)),
        true / (true + noise),
        c / fit.damping.value,
    )


def _own_zero(fitted: FittedPull) -> float:
    pull = fitted.pull
    seen = np.isfinite(pull.displacement)
    early = seen & (pull.marker_time <= pull.marker_time[seen][0] + OWN_START)
    return float(np.mean(pull.displacement[early]))


def _mean(values: Sequence[float] | NDArray[np.float64]) -> float | None:
    return float(np.mean(values)) if len(values) else None
