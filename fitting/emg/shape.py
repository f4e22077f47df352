"""Shape of EMG beside a model's activation: lag, and correlation at the lag, with 95 % intervals.

The gain and the baseline of EMG are not known, and no result depends on them. Both curves are smoothed by the same
filter and sampled at 1.6 times its bandwidth, where the autocorrelation due to the filter is small;
fitting/emg/regression.py models what remains.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from fitting.emg.channels import UnusableEmg
from fitting.emg.envelopes import smooth
from fitting.emg.regression import correlation_interval, lag_posterior
from fitting.results.codes import FitErrorCode

Array = NDArray[np.float64]

MAX_LAG_S = 0.5
"""Electromechanical delays are 0.03 to 0.1 s; a lag above half a second belongs to another movement."""
LAGS = 101
SAMPLES_PER_BANDWIDTH = 1.6
"""White noise behind the low-pass is then white within 5 % at all frequencies, aliases included."""
FEWEST_SAMPLES = 15
LEAST_ACTIVATION = 0.01
"""Smallest change of an activation that has a shape; solvers leave less in a muscle at rest."""
RATE_HZ = 100.0
"""Rate of the common grid on which both are smoothed and drawn."""
EDGE, WIDEST = 0.1, 1.0
"""Parts of max_lag: a lag is not identified if its interval is nearer to an end of the search, or wider, than these."""


class ShapeOutcome(StrEnum):
    """Outcome of a comparison. Codes are stable.

    COMPARED            correlation and lag are known
    LAG_NOT_IDENTIFIED  the interval of the lag is too wide, or reaches an end of the search
    MODEL_AT_REST       the model's activation changes by less than LEAST_ACTIVATION
    CONSTANT_EMG        the envelope is constant
    TOO_SHORT           the time in common has fewer than FEWEST_SAMPLES samples
    """

    COMPARED = "compared"
    LAG_NOT_IDENTIFIED = "lag_not_identified"
    MODEL_AT_REST = "model_at_rest"
    CONSTANT_EMG = "constant_emg"
    TOO_SHORT = "too_short"


@dataclass(frozen=True, eq=False)
class ShapeComparison:
    """EMG beside a model's activation.

    lag          [s], positive where EMG comes after the model
    correlation  Pearson's r at the lag, or at lag 0 where no lag is identified; both with 95 % intervals
    rmse         root mean square difference of the shapes at the same lag
    time         (n,) [s]; emg, model (n,): scaled from minimum (0) to maximum (1), not shifted
    Numbers are NaN for outcomes other than COMPARED and LAG_NOT_IDENTIFIED.
    """

    outcome: ShapeOutcome
    time: Array
    emg: Array
    model: Array
    correlation: float = np.nan
    correlation_ci95: tuple[float, float] = (np.nan, np.nan)
    lag: float = np.nan
    lag_ci95: tuple[float, float] = (np.nan, np.nan)
    rmse: float = np.nan


def compare_shapes(
    emg: tuple[Array, Array], model: tuple[Array, Array], bandwidth: float, max_lag: float = MAX_LAG_S
) -> ShapeComparison:
    """Compare an envelope with an activation, both (time [s], values) with increasing times, of any length.

    bandwidth [Hz] is that of the envelope's smoothing filter, which is applied to the activation too. Raises
    UnusableEmg if they have no time in common.
    """
    start, end = max(emg[0][0], model[0][0]), min(emg[0][-1], model[0][-1])
    if end - start <= 0.1:
        ends = {
            "emg_start_s": emg[0][0],
            "emg_end_s": emg[0][-1],
            "model_start_s": model[0][0],
            "model_end_s": model[0][-1],
        }
        raise UnusableEmg(FitErrorCode.EMG_OTHER_TIME, {name: float(value) for name, value in ends.items()})
    time = start + np.arange(int((end - start) * RATE_HZ + 1e-6) + 1) / RATE_HZ
    measured, activation = np.interp(time, *emg), np.interp(time, *model)
    if bandwidth < 0.45 * RATE_HZ:
        activation = smooth(activation, RATE_HZ, bandwidth)
    curves = time, _shape(measured), _shape(activation)
    if np.ptp(activation) < LEAST_ACTIVATION:
        return ShapeComparison(ShapeOutcome.MODEL_AT_REST, time, curves[1], np.zeros_like(time))
    if _is_constant(measured):
        return ShapeComparison(ShapeOutcome.CONSTANT_EMG, *curves)
    sampled = np.arange(start + max_lag, end - max_lag, 1 / (SAMPLES_PER_BANDWIDTH * bandwidth))
    if len(sampled) < FEWEST_SAMPLES:
        return ShapeComparison(ShapeOutcome.TOO_SHORT, *curves)
    return _compared(curves, sampled, max_lag)


def _compared(curves: tuple[Array, Array, Array], sampled: Array, max_lag: float) -> ShapeComparison:
    time, measured, activation = curves
    lags, interval = np.linspace(-max_lag, max_lag, LAGS), float(sampled[1] - sampled[0])
    response, shifted = np.interp(sampled, time, measured), np.interp(sampled - lags[:, None], time, activation)
    posterior = lag_posterior(response, shifted, lags, interval)
    low, lag, high = (float(quantile) for quantile in posterior.quantiles((0.025, 0.5, 0.975)))
    is_known = min(low + max_lag, max_lag - high) > EDGE * max_lag and high - low < WIDEST * max_lag
    at_lag = np.interp(sampled - (lag if is_known else 0.0), time, activation)
    if is_known:
        place = int(np.abs(lags - lag).argmin())
        ends = correlation_interval(response, shifted, posterior.weight, place, interval)
    else:
        over_noises = posterior.weight.sum(axis=1, keepdims=True)
        ends = correlation_interval(response, at_lag[None], over_noises, 0, interval)
    return ShapeComparison(
        ShapeOutcome.COMPARED if is_known else ShapeOutcome.LAG_NOT_IDENTIFIED,
        *curves,
        float(np.corrcoef(response, at_lag)[0, 1]),
        ends,
        lag,
        (low, high),
        float(np.sqrt(np.mean((response - at_lag) ** 2))),
    )


def _shape(values: Array) -> Array:
    """Scale from the minimum (0) to the maximum (1); zeros for a constant."""
    return np.zeros_like(values) if _is_constant(values) else (values - values.min()) / np.ptp(values)


def _is_constant(values: Array) -> bool:
    return bool(np.ptp(values) <= 1e-9 * float(np.abs(values).max()))
