"""Charts of the fit, trial by trial: the published study's figures of every repeat, and checks of the law."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import scipy

from documents.interval import plus_minus
from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.trial_fit import TrialFit
from fitting.diagnosis.fitted_pull import FittedPull
from fitting.dynamic.damping import DampingFit
from fitting.static.stiffness import StaticFit
from fitting.uncertainty import NORMAL_95, Estimate
from station.charts.marks import (
    COLOURS,
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
from station.report.figures import FORCE, MM, MOTION, stiffness_line

SHOWN = 8.0
"""Seconds of a swing that are drawn; in a longer one, measurement and fit cannot be distinguished."""
MOST_LAG = 1.0
"""Longest lag [s] of the autocorrelation of residuals."""


def repeat_figure(fit: CuffFit, static: FittedPull | None, dynamic: FittedPull | None) -> Chart:
    """One repeat: held loads, line and residuals; force and displacement of the swing; damper force over velocity.

    A trial that is missing or was not fitted has no panels.
    """
    columns: list[tuple[Panel, ...]] = []
    if static is not None and static.static is not None:
        columns.append((_held(fit, static, static.static), _residuals(fit, static, static.static)))
    if dynamic is not None and dynamic.dynamic is not None:
        columns += [tuple(_swing(dynamic, dynamic.dynamic)), (_damper(dynamic.dynamic),)]
    return Chart(tuple(columns))


def complex_stiffness_figure(fit: CuffFit) -> Chart:
    """Stiffness and damping in bands of frequency with 95 % intervals, and those of the fit."""
    bands = fit.complex_stiffness
    frequency = values([band.frequency for band in bands])
    swung = [trial.swing.stiffness.value for trial in fit.trials if trial.swing]
    left = [*_intervals(frequency, [band.stiffness for band in bands], FORCE, "bands of frequency")]
    right = [*_intervals(frequency, [band.damping for band in bands], MOTION, "bands of frequency")]
    if swung:
        left.append(Rule(float(np.mean(swung)), label="fit of the oscillations"))
    if fit.stiffness is not None:
        left.append(Rule(fit.stiffness.value, "quiet", "held loads", "dashed"))
    if fit.damping is not None:
        right += _pooled(fit.damping, "fit, 95 %")
    return chart(
        Panel(tuple(left), "frequency [Hz]", "Re K*, k [N/m]"),
        Panel(tuple(right), "frequency [Hz]", "Im K* / 2πf, c [N s/m]"),
    )


def residual_figure(dynamic: Sequence[FittedPull]) -> Chart:
    """Residual force of the oscillations: over time, its autocorrelation, and against a normal distribution."""
    over_time: list[Mark] = []
    later: list[Mark] = []
    quantiles: list[Mark] = []
    swings = [(fitted.pull.trial.repeat, fitted.dynamic) for fitted in dynamic if fitted.dynamic is not None]
    for (repeat, swing), colour in zip(swings, COLOURS * 8, strict=False):
        residual, label = _force_residual(swing), f"repeat {repeat}"
        over_time.append(Cloud(swing.time, residual, colour, label))
        step = float(np.median(np.diff(swing.time)))
        correlation = _autocorrelation(residual, max(2, round(MOST_LAG / step)))
        later.append(Line(step * values(range(1, len(correlation) + 1)), correlation, colour, label, width=1.0))
        expected = values(scipy.stats.norm.ppf((np.arange(len(residual)) + 0.5) / len(residual)))
        quantiles.append(Line(expected, np.sort(residual) / float(np.std(residual)), colour, label))
    limit = float(NORMAL_95 / np.sqrt(min(len(swing.time) for _, swing in swings)))
    later.insert(0, Strip(-limit, limit, label="95 % of white noise"))
    quantiles.append(Line(values([-4, 4]), values([-4, 4]), "ink", "normal", "dashed", 1.0))
    return chart(
        Panel(tuple(over_time), "session time [s]", "residual force [N]", width=THIRD),
        Panel(tuple(later), "time lag [s]", "autocorrelation", width=THIRD),
        Panel(tuple(quantiles), "normal quantile", "residual / its standard deviation", width=THIRD),
    )


def repeats_figure(fit: CuffFit) -> Chart:
    """k, c and migration of every repeat with 95 % intervals, and the donning's as a band."""
    used = [trial for trial in fit.trials if trial.state == "used"]
    return chart(
        _repeats(used, "stiffness", fit.stiffness, "k [N/m]"),
        _repeats(used, "damping", fit.damping, "c [N s/m]"),
        _repeats(used, "migration", fit.migration, "migration [mm]"),
    )


def _repeats(used: Sequence[TrialFit], name: str, pooled: Estimate | None, axis: str) -> Panel:
    scale = MM if name == "migration" else 1.0
    found = [(trial.repeat, value.scaled(scale)) for trial in used if (value := _of_trial(trial, name)) is not None]
    numbers = sorted({repeat for repeat, _ in found})
    marks: list[Mark] = []
    top = None
    if pooled is not None:
        pooled, label = pooled.scaled(scale), "mean, 95 %"
        if name == "migration":
            label = f"donning as a whole, {plus_minus(pooled.value, pooled.ci95)}"
            top = 1.15 * max(pooled.ci95[1], 0.0, *(value.value for _, value in found)) or None
        marks += _pooled(pooled, label)
    places = values([numbers.index(repeat) for repeat, _ in found])
    marks += _intervals(places, [value for _, value in found], FORCE, "single repeat")
    return Panel(
        tuple(marks),
        "repeat",
        axis,
        x_names=tuple(map(str, numbers)),
        y_limits=(None, top),
        height=190.0,
        width=THIRD,
    )


def _held(fit: CuffFit, curves: FittedPull, held: StaticFit) -> Panel:
    """Force over displacement with the held loads and a line for every stretch between slips."""
    force = np.interp(curves.pull.marker_time, curves.pull.force_time, curves.pull.force)
    loads = values([plateau.force for plateau in held.plateaus])
    marks: list[Mark] = [
        Line(MM * curves.pull.displacement, force, "quiet", width=0.6),
        Points(MM * held.x, loads, FORCE, "held loads"),
    ]
    for inside, x, load in _segments(fit, held, loads):
        label = _with_interval("k", fit.stiffness, "N/m") if fit.stiffness else ""
        slope = fit.stiffness.value if fit.stiffness else 0.0
        marks.append(stiffness_line(slope, held.x[inside], load - slope * x, label))
    title = f"static, repeat {curves.pull.trial.repeat}"
    return Panel(tuple(marks), y_label="force [N]", title=title, height=200.0, width=THIRD, has_x_numbers=False)


def _residuals(fit: CuffFit, curves: FittedPull, held: StaticFit) -> Panel:
    """Displacement of the held loads beside the line, with 95 % intervals."""
    loads = values([plateau.force for plateau in held.plateaus])
    marks: list[Mark] = [Rule(0.0)]
    for inside, x, load in _segments(fit, held, loads):
        slope = fit.stiffness.value if fit.stiffness else 1.0
        off, reach = MM * (held.x[inside] - x - (loads[inside] - load) / slope), MM * NORMAL_95 * held.x_sd[inside]
        marks.append(Intervals(MM * held.x[inside], off - reach, off + reach, FORCE, is_upright=True))
        marks.append(Points(MM * held.x[inside], off, FORCE))
    seen = MM * curves.pull.displacement
    x_limits = (float(np.nanmin(seen)), float(np.nanmax(seen)))
    return Panel(
        tuple(marks),
        "displacement along the rope [mm]",
        "residual [mm]",
        x_limits=_with_margin(x_limits),
        height=130.0,
        width=THIRD,
    )


def _with_margin(ends: tuple[float, float]) -> tuple[float, float]:
    """As the panel above leaves it."""
    free = 0.05 * (ends[1] - ends[0])
    return ends[0] - free, ends[1] + free


def _segments(fit: CuffFit, held: StaticFit, loads: Array) -> Iterator[tuple[Array, float, float]]:
    """Held loads between two slips: which, and their weighted mean displacement and force."""
    for segment in np.unique(held.segment) if fit.stiffness is not None else ():
        inside = held.segment == segment
        if inside.sum() > 1:  # a single one determines no line
            weight = held.x_sd[inside] ** -2.0
            yield (
                inside,
                float(np.average(held.x[inside], weights=weight)),
                float(np.average(loads[inside], weights=weight)),
            )


def _swing(curves: FittedPull, swing: DampingFit) -> Iterator[Panel]:
    """Force and displacement as measured and as fitted, for the first seconds of what was fitted."""
    start, end = float(swing.time[0]), min(float(swing.time[-1]), float(swing.time[0]) + SHOWN)
    force = (curves.pull.force_time >= start) & (curves.pull.force_time <= end)
    seen = (curves.pull.marker_time >= start) & (curves.pull.marker_time <= end)
    fitted = swing.time <= end
    law = swing.offset + swing.stiffness.value * swing.displacement + swing.damping.value * swing.velocity
    whole = float(swing.time[-1] - swing.time[0])
    yield Panel(
        (
            Cloud(curves.pull.force_time[force], curves.pull.force[force], FORCE, "measured"),
            Line(swing.time[fitted], law[fitted], "ink", "fitted", width=0.9),
        ),
        y_label="force [N]",
        title=f"dynamic, repeat {curves.pull.trial.repeat}: {end - start:.0f} s of {whole:.0f} s",
        height=165.0,
        width=THIRD,
        has_x_numbers=False,
    )
    yield Panel(
        (
            Cloud(curves.pull.marker_time[seen], MM * curves.pull.displacement[seen], MOTION),
            Line(swing.time[fitted], MM * swing.displacement[fitted], "ink", width=0.9),
        ),
        "session time [s]",
        "displacement [mm]",
        height=165.0,
        width=THIRD,
    )


def _damper(swing: DampingFit) -> Panel:
    ends = values([swing.velocity.min(), 0.0, swing.velocity.max()])
    low, high = swing.damping.estimate.ci95
    edges = np.sort(np.stack([low * ends, high * ends]), axis=0)
    return Panel(
        (
            Cloud(MM * swing.velocity, swing.damper_force, FORCE),
            Band(MM * ends, edges[0], edges[1], "quiet"),
            Line(MM * ends, swing.damping.value * ends, "ink", _with_interval("c", swing.damping.estimate, "N s/m")),
        ),
        "velocity [mm/s]",
        "F − k x [N]",
        title="damper",
        height=330.0,
        width=THIRD,
    )


def _with_interval(symbol: str, estimate: Estimate, unit: str) -> str:
    return f"{symbol} = {plus_minus(estimate.value, estimate.ci95)} {unit} (95 %)"


def _intervals(across: Array, found: Sequence[Estimate], colour: Colour, label: str) -> Iterator[Mark]:
    ends = values([estimate.ci95 for estimate in found]).reshape(-1, 2)
    yield Intervals(across, ends[:, 0], ends[:, 1], colour, is_upright=True)
    titles = tuple(plus_minus(estimate.value, estimate.ci95) for estimate in found)
    yield Points(across, values([estimate.value for estimate in found]), colour, label, titles=titles)


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
