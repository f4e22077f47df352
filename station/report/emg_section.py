"""The report's section on EMG, from emg.json: tables, and charts of the shapes and of the change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from fitting.emg.shape import ShapeOutcome
from station.charts.marks import QUARTER, Chart, Intervals, Line, Mark, Panel, Points, Rule, chart, values
from station.emg.emg_json import (
    EMG_FILE,
    EmgChangeEntry,
    EmgChannel,
    EmgDocument,
    EmgTrialEntry,
    ShapeRow,
    findings_text,
    method_text,
    shape_rows,
)
from station.report.numbers import LocatedObject, Shown, located, plain
from station.report.pictures import Picture, PlannedFigure
from station.report.report_file import Source


@dataclass(frozen=True)
class ReportedEmg:
    """Rows as text with the entry of emg.json, or the entries alone."""

    document: EmgDocument
    method: tuple[Shown, ...]
    findings: list[str]
    shapes: list[tuple[ShapeRow, LocatedObject]]
    pooled: Sequence[LocatedObject]
    changes: Sequence[LocatedObject]
    pictures: Sequence[Picture]


def emg_section(document: EmgDocument, pictures: Sequence[Picture]) -> ReportedEmg:
    content: LocatedObject = located(document.model_dump(mode="json"), Source.of(EMG_FILE))
    shapes = [channel["shape"] for trial in content["trials"] for channel in trial["channels"] if channel["shape"]]
    return ReportedEmg(
        document,
        _method(document, content["setup"]["envelope"]),
        list(findings_text(document)),
        list(zip(shape_rows(document), shapes, strict=True)),
        content["pooled"],
        content["changes"],
        pictures,
    )


def _method(document: EmgDocument, envelope: LocatedObject) -> tuple[Shown, ...]:
    """As method_text, whose numbers are those of the set-up; a published method has none of its own."""
    text = method_text(document.setup.envelope)
    keys = {"seth_2019": (), "rms": ("window_s",)}.get(envelope["method"], ("low_pass_hz",))
    numbers = [plain(number) for number in envelope["band_hz"] if keys]
    numbers += [plain(envelope[key]) for key in keys]
    parts: list[Shown] = []
    for number in numbers:
        before, _, text = text.partition(str(number))
        parts += [before, number]
    return (*parts, text)


def emg_figures(document: EmgDocument) -> list[PlannedFigure]:
    """The shapes of every trial that is compared with the model, and the change where there is one."""
    figures = [
        PlannedFigure(
            partial(shapes_figure, trial),
            f"{trial.name}: shape of EMG and of the model's activation, both scaled from minimum (0) to maximum (1)",
            is_wide=True,
        )
        for trial in document.trials
        if trial.compared
    ]
    if document.changes:
        caption = "EMG and the model's activation in the condition over those in the reference, with 95 % intervals"
        figures.append(PlannedFigure(partial(change_figure, document.changes), caption))
    return figures


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
