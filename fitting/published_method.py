"""The published method, equation by equation, for comparison: what it gives on the same trials, and what noise takes.

    (1) F = k x + c ẋ
    (2) F = k x            k through the origin, from the means of the held loads, x from the record's own start
    (3) ẋ = Δx / Δt        central difference from frame to frame
    (4) F − k x = c ẋ      c through the origin, F at the frames, x from the dynamic record's own start
    (5) migration = x at the end − x at the start of a static record

Noise of s_x per frame makes ẋ noisy by s_v = s_x / (√2 Δt), and a slope over a noisy abscissa is too small: of c is
left S_v / (S_v + s_v²), S_v being the mean square of the true velocity. That factor is predicted from the fit of the
same record by errors in variables, and stands beside the one observed.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.curves import TrialCurves
from fitting.result import SessionFit

OWN_START = 1.0
"""Seconds at a record's start whose mean is its zero."""


@dataclass(frozen=True)
class PublishedFit:
    """A cuff by equations 1 to 5: means over the repeats, None where there is no such trial.

    stiffness [N/m], damping [N s/m], migration [m]
    damper_force        mean of F − k x in the dynamic records [N]
    negative_part       part of its samples that are negative
    predicted_left      part of c that is left by differences of noisy frames, predicted
    observed_left       c here over c of the errors-in-variables fit of the same records
    """

    stiffness: float | None
    damping: float | None
    migration: float | None
    damper_force: float | None
    negative_part: float | None
    predicted_left: float | None
    observed_left: float | None


def published_fits(session: SessionFit) -> dict[str, PublishedFit]:
    """Every cuff as last donned, from the trials that the session's fit used."""
    return {
        name: _fit_cuff([session.curves[trial.file] for trial in fit.trials if trial.file in session.curves])
        for name, fit in session.cuffs.items()
    }


def plain_published(fits: Mapping[str, PublishedFit]) -> dict[str, dict[str, float | None]]:
    """As plain data, units in the keys."""
    return {
        name: {
            "stiffness_n_per_m": fit.stiffness,
            "damping_n_s_per_m": fit.damping,
            "migration_m": fit.migration,
            "mean_damper_force_n": fit.damper_force,
            "negative_part": fit.negative_part,
            "predicted_part_of_damping_left": fit.predicted_left,
            "observed_part_of_damping_left": fit.observed_left,
        }
        for name, fit in fits.items()
    }


def _fit_cuff(trials: Sequence[TrialCurves]) -> PublishedFit:
    static = [(each, *_held(each)) for each in trials if each.static and len(each.static.plateaus) > 1]
    slopes = {each.trial.repeat: float(x @ force / (x @ x)) for each, x, force in static if x @ x > 0}
    stiffness = _mean(list(slopes.values()))
    swings = np.empty((0, 5))
    if stiffness is not None:
        of_repeat = [(each, slopes.get(each.trial.repeat, stiffness)) for each in trials if each.dynamic is not None]
        swings = np.array([_swing(each, k) for each, k in of_repeat]).reshape(-1, 5)
    migration = _mean([float(x[-1] - x[0]) for _, x, _ in static])
    damping, *rest = (_mean(column) for column in swings.T)
    return PublishedFit(stiffness, damping, migration, *rest)


def _held(curves: TrialCurves) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Displacement from the record's own start and force of the held loads (plateaus,) [m], [N]."""
    plateaus = curves.static.plateaus if curves.static else ()
    x = np.array([plateau.displacement for plateau in plateaus]) - _own_zero(curves)
    return x, np.array([plateau.force for plateau in plateaus])


def _swing(curves: TrialCurves, k: float) -> tuple[float, float, float, float, float]:
    """c, mean of F − k x, its negative part, and the parts of c left as predicted and as observed."""
    fit = curves.dynamic
    if fit is None:
        raise ValueError("a trial without a fitted swing has no damping")
    step = float(np.median(np.diff(curves.marker_time)))
    velocity = (curves.displacement[2:] - curves.displacement[:-2]) / (2 * step)
    time = curves.marker_time[1:-1]
    inside = (time >= fit.oscillation.start) & (time <= fit.oscillation.end) & np.isfinite(velocity)
    inside &= np.isfinite(curves.displacement[1:-1])
    displacement = curves.displacement[1:-1][inside] - _own_zero(curves)
    left = np.interp(time[inside], curves.force_time, curves.force) - k * displacement
    v = velocity[inside]
    c = float(v @ left / (v @ v))
    true, noise = float(np.mean(fit.velocity**2)), fit.marker_noise**2 / (2 * step**2)
    return c, float(np.mean(left)), float(np.mean(left < 0)), true / (true + noise), c / fit.damping.value


def _own_zero(curves: TrialCurves) -> float:
    seen = np.isfinite(curves.displacement)
    early = seen & (curves.marker_time <= curves.marker_time[seen][0] + OWN_START)
    return float(np.mean(curves.displacement[early]))


def _mean(values: Sequence[float] | NDArray[np.float64]) -> float | None:
    return float(np.mean(values)) if len(values) else None
