"""The wearer in the report: charts of the motions, and from emg.json the tables and charts of the EMG."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from fitting.emg.channels import UnusableEmg
from fitting.emg.envelopes import EmgEnvelopes, compute_envelopes, largest_envelopes, normalised
from fitting.emg.shape import ShapeOutcome
from fitting.errors import UnusableTrial
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.errors import RecordingError
from recordings.manifest import Manifest
from station import charts
from station.charts.marks import (
    COLOURS,
    HALF,
    QUARTER,
    Array,
    Chart,
    Intervals,
    Line,
    Mark,
    Panel,
    Points,
    Rule,
    chart,
    values,
)
from station.charts.svg import draw
from station.emg.emg_json import (
    EMG_FILE,
    EmgChangeEntry,
    EmgChannel,
    EmgDocument,
    EmgShape,
    EmgTrialEntry,
    ShapeRow,
    findings_text,
    method_text,
    shape_rows,
)
from station.emg.trials import EmgFileError, extract_emg
from station.protocol import CONDITION_NAMES
from station.recordings_of_session import motions_in
from station.report.numbers import Shown, located, plain
from station.report.pictures import Picture, PlannedPicture
from station.report.report_file import Source

SHOWN_POINTS = 500
"""Of a curve."""
CAPTION = "Motion, {worn}: elevation of the arm, with the start of each cycle"
EMG_CAPTION = "EMG envelopes as a share of the maximum voluntary contraction"
RAW_CAPTION = "EMG envelopes, without a maximum voluntary contraction"
CORD_CAPTION = "force of the cord, less its least value"


def wearer_figures(folder: Path) -> list[PlannedPicture]:
    """A figure for every motion that can be read. The load cell is shown where it is in the cord."""
    found = motions_in(folder)
    if not found:
        return []
    maxima = _maxima(found)
    return [
        PlannedPicture(partial(motion_figure, trial, maxima), _caption(trial, maxima), is_printed=True)
        for path, manifest in sorted(found.items(), key=lambda motion: motion[1].start_utc_ns)
        if manifest.condition != "mvc" and (trial := _read(path)) is not None
    ]


def motion_drawing(path: Path, trial: WearerTrial) -> str:
    """The figure of one motion as HTML, with its own colours."""
    maxima = _maxima(motions_in(path.parent))
    style = Path(charts.__file__).with_name("chart.css").read_text(encoding="utf-8")
    return f"<style>{style}</style>{draw(motion_figure(trial, maxima), _caption(trial, maxima))}"


def motion_figure(trial: WearerTrial, maxima: Mapping[str, float]) -> Chart:
    """Elevation, EMG and cord force over session time, one below the other."""
    panels = [*_elevation(trial), *_emg(trial, maxima), *_cord(trial)]
    last = len(panels) - 1
    return Chart((tuple(_over_time(panel, trial, is_last=place == last) for place, panel in enumerate(panels)),))


def _caption(trial: WearerTrial, maxima: Mapping[str, float]) -> str:
    condition = trial.manifest.condition
    parts = [CAPTION.format(worn=CONDITION_NAMES[condition] if condition else "")]
    if _envelopes(trial) is not None:
        parts.append(EMG_CAPTION if maxima else RAW_CAPTION)
    if trial.body.is_cord_measured:
        parts.append(CORD_CAPTION)
    return "; ".join(parts)


def _read(path: Path) -> WearerTrial | None:
    try:
        return read_wearer_trial(path)
    except (UnusableTrial, RecordingError):
        return None  # the list of recordings has the reason


def _maxima(found: Mapping[Path, Manifest]) -> dict[str, float]:
    """Channel → largest envelope in a maximal contraction."""
    trials = [_read(path) for path, manifest in found.items() if manifest.condition == "mvc"]
    envelopes = [_envelopes(trial) for trial in trials if trial is not None]
    return largest_envelopes([one for one in envelopes if one is not None])


def _envelopes(trial: WearerTrial) -> EmgEnvelopes | None:
    if trial.emg is None:
        return None
    try:
        return compute_envelopes(extract_emg(trial))
    except (EmgFileError, UnusableEmg):
        return None


def _elevation(trial: WearerTrial) -> Iterator[Panel]:
    if trial.elevation is not None:
        cycles = (Rule(cycle.start, "quiet", dash="dotted", is_upright=True) for cycle in trial.cycles)
        yield Panel((_line(trial.time, np.degrees(trial.elevation), 1), *cycles), y_label="elevation [°]")


def _emg(trial: WearerTrial, maxima: Mapping[str, float]) -> Iterator[Panel]:
    envelopes = _envelopes(trial)
    if envelopes is None:
        return
    levels = normalised(envelopes, maxima) if maxima else envelopes
    scale, unit = (100.0, "EMG [% MVC]") if maxima else (1e6, "EMG [µV]")
    labels = enumerate(levels.usable)
    yield Panel(
        tuple(_line(levels.time, scale * levels.of(label), place, label) for place, label in labels), y_label=unit
    )


def _cord(trial: WearerTrial) -> Iterator[Panel]:
    if trial.body.is_cord_measured and len(trial.force):
        yield Panel((_line(trial.force_time, trial.force - float(np.nanmin(trial.force)), 2),), y_label="cord [N]")


def _line(time: Array, curve: Array, colour: int, label: str = "") -> Line:
    """At most SHOWN_POINTS, the means of equal parts of the curve."""
    every = max(1, len(time) // SHOWN_POINTS)
    kept = every * (len(time) // every)
    x, y = (values(part[:kept]).reshape(-1, every).mean(axis=1) for part in (time, curve))
    return Line(x, y, COLOURS[colour % len(COLOURS)], label, width=1.2)


def _over_time(panel: Panel, trial: WearerTrial, *, is_last: bool) -> Panel:
    limits = float(trial.time[0]), float(trial.time[-1])
    label, height = ("time from the sync edge [s]", 130.0) if is_last else ("", 100.0)
    return Panel(panel.marks, label, panel.y_label, x_limits=limits, width=HALF, height=height, has_x_numbers=is_last)


@dataclass(frozen=True)
class ReportedEmg:
    """Rows as text with the entry of emg.json, or the entries alone."""

    document: EmgDocument
    method: tuple[Shown, ...]
    findings: list[str]
    shapes: list[tuple[ShapeRow, EmgShape]]
    pictures: Sequence[Picture]


def emg_section(document: EmgDocument, pictures: Sequence[Picture]) -> ReportedEmg:
    document = located(document, Source.of(EMG_FILE))
    shapes = [channel.shape for trial in document.trials for channel in trial.channels if channel.shape]
    return ReportedEmg(
        document,
        _method(document),
        list(findings_text(document)),
        list(zip(shape_rows(document), shapes, strict=True)),
        pictures,
    )


def _method(document: EmgDocument) -> tuple[Shown, ...]:
    """As method_text, whose numbers are those of the set-up; a published method has none of its own."""
    envelope = document.setup.envelope
    text = method_text(envelope)
    keys = {"seth_2019": (), "rms": ("window_s",)}.get(envelope.method, ("low_pass_hz",))
    numbers = [plain(number) for number in envelope.band_hz if keys]
    numbers += [plain(getattr(envelope, key)) for key in keys]
    parts: list[Shown] = []
    for number in numbers:
        before, _, text = text.partition(str(number))
        parts += [before, number]
    return (*parts, text)


def emg_figures(document: EmgDocument) -> list[PlannedPicture]:
    """The shapes of every trial that is compared with the model, and the change where there is one."""
    figures = [
        PlannedPicture(
            partial(shapes_figure, trial),
            f"{trial.name}: shape of EMG and of the model's activation, both scaled from minimum (0) to maximum (1)",
            is_wide=True,
        )
        for trial in document.trials
        if trial.compared
    ]
    if document.changes:
        caption = "EMG and the model's activation in the condition over those in the reference, with 95 % intervals"
        figures.append(PlannedPicture(partial(change_figure, document.changes), caption))
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
