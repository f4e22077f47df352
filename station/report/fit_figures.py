"""Charts of the fit: by trial its repeats and checks of the law; by cuff held loads, tangent stiffness, damping."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import scipy

from documents.interval import UNBROKEN, plus_minus
from fitting.cuffs.cuff_fit import CuffFit, TrialFit
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.diagnosis.identification import FittedPull
from fitting.dynamic.damping import DampingFit
from fitting.uncertainty import NORMAL_95, Estimate
from station.charts.marks import (
    COLOURS,
    SIXTH,
    THIRD,
    Array,
    Band,
    Chart,
    Cloud,
    Colour,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    Strip,
    chart,
    values,
)

HEIGHT = 128.0
"""Of a panel [px]."""
MOST_LAG = 1.0
"""Longest lag [s] of the autocorrelation of residuals."""
FORCE: Colour = "c1"
MOTION: Colour = "c2"
MM = 1e3
CURVE_HEIGHT = 165.0
"""Of a panel [px]."""
DOT, RING = 3.0, 2.4
"""Radius [px] of a dot, and distance [px] between the rings around it."""


def checks_figure(fit: CuffFit, dynamic: Sequence[FittedPull], true: Mapping[str, float]) -> Chart:
    """k and c of single repeats, where there are several, with the donning's as a band and the true ones by their keys;
    k and c in bands of frequency; the residual force of the oscillations.
    """
    used = [trial for trial in fit.trials if trial.state == "used"]
    panels = []
    if len({trial.repeat for trial in used}) > 1:
        for name, axis in (("stiffness", "k [N/m]"), ("damping", "c [N s/m]")):
            panels.append(_repeats(used, name, getattr(fit, name), axis, true.get(QUANTITIES[name])))
    return chart(*panels, *_complex_stiffness(fit), *_residuals(dynamic))


def _repeats(used: Sequence[TrialFit], name: str, pooled: Estimate | None, axis: str, true: float | None) -> Panel:
    found = [(trial.repeat, value) for trial in used if (value := _of_trial(trial, name)) is not None]
    numbers = sorted({repeat for repeat, _ in found})
    marks: list[Mark] = [] if pooled is None else [*_pooled(pooled, "pooled")]
    if true is not None:
        marks.append(Rule(true, "c2", "true", "dashed"))
    places = values([numbers.index(repeat) for repeat, _ in found])
    marks += _intervals(places, [value for _, value in found], FORCE)
    return _small(marks, "repeat", axis, tuple(map(str, numbers)))


def _small(marks: Sequence[Mark], x_label: str, y_label: str, x_names: tuple[str, ...] = ()) -> Panel:
    return Panel(tuple(marks), x_label, y_label, x_names=x_names, width=SIXTH, height=HEIGHT)


def _complex_stiffness(fit: CuffFit) -> Iterator[Panel]:
    bands = fit.complex_stiffness
    if not bands:
        return
    frequency = values([band.frequency for band in bands])
    swung = [trial.swing.stiffness.value for trial in fit.trials if trial.swing]
    left = [*_intervals(frequency, [band.stiffness for band in bands], FORCE)]
    right = [*_intervals(frequency, [band.damping for band in bands], MOTION)]
    if swung:
        left.append(Rule(float(np.mean(swung)), label="swings"))
    if fit.stiffness is not None:
        left.append(Rule(fit.stiffness.value, "quiet", "loads", "dashed"))
    if fit.damping is not None:
        right += _pooled(fit.damping, "fit")
    yield _small(left, "frequency [Hz]", "Re K* [N/m]")
    yield _small(right, "frequency [Hz]", "Im K* / 2πf [N s/m]")


def _residuals(dynamic: Sequence[FittedPull]) -> tuple[Panel, ...]:
    """Autocorrelation, and quantiles beside those of a normal distribution."""
    later: list[Mark] = []
    quantiles: list[Mark] = []
    swings = [fitted.dynamic for fitted in dynamic if fitted.dynamic is not None]
    if not swings:
        return ()
    for swing, colour in zip(swings, COLOURS * 8, strict=False):
        residual = _force_residual(swing)
        step = float(np.median(np.diff(swing.time)))
        correlation = _autocorrelation(residual, max(2, round(MOST_LAG / step)))
        later.append(Line(step * values(range(1, len(correlation) + 1)), correlation, colour, width=1.0))
        expected = values(scipy.stats.norm.ppf((np.arange(len(residual)) + 0.5) / len(residual)))
        quantiles.append(Line(expected, np.sort(residual) / float(np.std(residual)), colour))
    limit = float(NORMAL_95 / np.sqrt(min(len(swing.time) for swing in swings)))
    later.insert(0, Strip(-limit, limit, label="white noise"))
    quantiles.append(Line(values([-4, 4]), values([-4, 4]), "ink", "normal", "dashed", 1.0))
    return _small(later, "time lag [s]", "autocorrelation"), _small(quantiles, "normal quantile", "residual / SD")


def _intervals(across: Array, found: Sequence[Estimate], colour: Colour) -> Iterator[Mark]:
    ends = values([estimate.ci95 for estimate in found]).reshape(-1, 2)
    yield Intervals(across, ends[:, 0], ends[:, 1], colour, is_upright=True)
    titles = tuple(plus_minus(estimate.value, estimate.ci95) for estimate in found)
    yield Points(across, values([estimate.value for estimate in found]), colour, titles=titles)


def _pooled(pooled: Estimate, label: str) -> tuple[Mark, Mark]:
    return Strip(*pooled.ci95, label=label), Rule(pooled.value)


def _of_trial(trial: TrialFit, name: str) -> Estimate | None:
    value: Estimate | None = getattr(trial, name)
    return value if value is not None and np.isfinite(value.ci95).all() else None


def _force_residual(swing: DampingFit) -> Array:
    """F − k x − c ẋ − m ẍ − F0 − F1 u (n,) [N]."""
    return np.asarray(swing.damper_force - swing.damping.value * swing.velocity)


def _autocorrelation(residual: Array, most: int) -> Array:
    """At 1 … most samples' distance."""
    centred = residual - residual.mean()
    power = np.abs(np.fft.rfft(centred, 2 * len(residual))) ** 2
    correlation = np.fft.irfft(power)[: most + 1]
    return np.asarray(correlation[1:] / correlation[0])


def fit_figure(fit: CuffFit, static: Sequence[FittedPull], dynamic: Sequence[FittedPull]) -> Chart:
    """Held loads of all static trials with the lines of the common stiffness; the tangent stiffness k(F) where the held
    loads determine one; F − k x over ẋ of all dynamic trials with the line of the common damping.
    """
    panels = []
    if static:
        marks: list[Mark] = []
        for later, (curves, colour) in enumerate(zip(static, COLOURS * 8, strict=False), 1 - len(static)):
            marks += _held_loads(curves, fit, colour, RING * -later)
        panels.append(_third(marks, "displacement along the rope [mm]", "force [N]"))
    tangents = fit.held.tangents if fit.held and static else ()
    if tangents:
        panels.append(_tangents(fit, tangents))
    if dynamic:
        panels.append(_damper(fit, dynamic))
    return chart(*panels)


def _third(marks: Sequence[Mark], x_label: str, y_label: str) -> Panel:
    return Panel(tuple(marks), x_label, y_label, width=THIRD, height=CURVE_HEIGHT)


def _damper(fit: CuffFit, dynamic: Sequence[FittedPull]) -> Panel:
    """F − k x, less inertia, offset and drift."""
    marks: list[Mark] = []
    reach = 0.0
    for curves, colour in zip(dynamic, COLOURS * 8, strict=False):
        if curves.dynamic is not None:
            label = f"repeat {curves.pull.trial.repeat}"
            marks.append(Cloud(MM * curves.dynamic.velocity, curves.dynamic.damper_force, colour, label))
            reach = max(reach, float(np.abs(curves.dynamic.velocity).max()))
    if fit.damping is not None and reach:
        line = values([-reach, reach])
        marks.append(Line(MM * line, fit.damping.value * line, "ink", f"c = {fit.damping.value:.0f} N s/m"))
    return _third(marks, "velocity of the cuff [mm/s]", "F − k x [N]")


def _tangents(fit: CuffFit, tangents: Sequence[tuple[float, Estimate]]) -> Panel:
    """k(F) of the exponential law beside the straight line's k."""
    force = values([load for load, _ in tangents])
    low, high = values([stiffness.ci95 for _, stiffness in tangents]).T
    marks: list[Mark] = [
        Band(force, low, high, FORCE, f"its 95{UNBROKEN}% interval"),
        Line(force, values([stiffness.value for _, stiffness in tangents]), FORCE, "exponential law, tangent"),
    ]
    if fit.stiffness is not None:
        marks.append(Rule(fit.stiffness.value, label=f"k = {fit.stiffness.value:.0f} N/m"))
    return _third(marks, "load above the bare hook [N]", "tangent stiffness k(F) [N/m]")


def _held_loads(curves: FittedPull, fit: CuffFit, colour: Colour, wider: float) -> Iterator[Mark]:
    """Dots of the last repeat, and rings around them of the others, which would be hidden; wider [px] than a dot."""
    if curves.static is None:
        return
    x = values([plateau.displacement for plateau in curves.static.plateaus])
    force = values([plateau.force for plateau in curves.static.plateaus])
    label = f"repeat {curves.pull.trial.repeat}"
    yield Points(MM * x, force, colour, label, is_hollow=wider > 0, radius=DOT + wider)
    if fit.stiffness is None:
        return
    for segment in np.unique(curves.static.segment):
        inside = curves.static.segment == segment
        if inside.sum() > 1:
            ends = values([x[inside].min(), x[inside].max()])
            yield Line(MM * ends, fit.stiffness.value * ends + curves.static.offset[inside][0], "ink")
