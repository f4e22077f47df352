"""The report's section on EMG, from emg.json: tables, and figures of the shapes and of the change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from station.emg.emg_json import EMG_FILE, EmgDocument
from station.emg.emg_tables import ShapeRow, findings_text, method_text, shape_rows
from station.report.emg_figures import change_figure, shapes_figure
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
