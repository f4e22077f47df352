"""Charts of EMG beside the model's activation."""

from __future__ import annotations

from collections.abc import Sequence

from fitting.emg.shape import ShapeOutcome
from station.charts.marks import QUARTER, Chart, Intervals, Line, Mark, Panel, Points, Rule, chart, values
from station.emg.emg_json import EmgChangeEntry, EmgChannel, EmgTrialEntry


def shapes_figure(trial: EmgTrialEntry) -> Chart:
    """A panel per channel: EMG and the model's activation over time, without a scale of amplitude."""
    return chart(*(_shapes(channel) for channel in trial.compared), has_one_legend=True)


def change_figure(changes: Sequence[EmgChangeEntry]) -> Chart:
    """A row per channel: ratio of EMG with its interval, and the model's ratio."""
    rows = values(range(len(changes)))
    low, high = values([change.emg_ratio.ci95 or (None, None) for change in changes]).T
    return chart(
        Panel(
            (
                Rule(1.0, "quiet", is_upright=True),
                Intervals(rows, low, high, "c2", is_upright=False),
                Points(values([change.emg_ratio.value for change in changes]), rows, "c2", "EMG"),
                Points(
                    values([change.model_ratio.value for change in changes]),
                    rows,
                    "c1",
                    "model's activation",
                    is_hollow=True,
                ),
            ),
            "condition / reference",
            y_names=tuple(change.channel for change in changes),
            height=80.0 + 24.0 * len(changes),
            width=460.0,
        )
    )


def _shapes(channel: EmgChannel) -> Panel:
    found = channel.shape
    marks: list[Mark] = []
    if found is not None:
        time = values(found.time_s)
        marks.append(Line(time, values(found.model_shape), "ink", "model's activation"))
        marks.append(Line(time, values(found.emg_shape), "c2", "EMG"))
    labels = "time [s]", "shape, min to max"
    return Panel(tuple(marks), *labels, title=_title(channel), y_limits=(-0.05, 1.1), width=QUARTER, height=150.0)


def _title(channel: EmgChannel) -> str:
    found = channel.shape
    if found is None or found.correlation.value is None:
        return channel.channel
    lag = found.lag_s.value
    shown = f", {1e3 * lag:.0f} ms" if found.outcome is ShapeOutcome.COMPARED and lag is not None else ""
    return f"{channel.channel}: r = {found.correlation.value:.2f}{shown}"
