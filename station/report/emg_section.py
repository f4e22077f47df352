"""The report's section on EMG, from emg.json: tables as text, and figures of the shapes and of the change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial

from station.emg.emg_json import EmgDocument
from station.emg.emg_tables import (
    ChangeRow,
    PooledRow,
    ShapeRow,
    change_rows,
    findings_text,
    method_text,
    pooled_rows,
    shape_rows,
)
from station.report.emg_figures import change_figure, shapes_figure
from station.report.pictures import Picture, PlannedFigure


@dataclass(frozen=True)
class ReportedEmg:
    document: EmgDocument
    method: str
    findings: list[str]
    shapes: list[ShapeRow]
    pooled: list[PooledRow]
    changes: list[ChangeRow]
    pictures: Sequence[Picture]


def emg_section(document: EmgDocument, pictures: Sequence[Picture]) -> ReportedEmg:
    return ReportedEmg(
        document,
        f"Envelopes: {method_text(document.setup.envelope)}",
        list(findings_text(document)),
        list(shape_rows(document)),
        list(pooled_rows(document)),
        list(change_rows(document)),
        pictures,
    )


def emg_figures(document: EmgDocument) -> list[PlannedFigure]:
    """The shapes of every trial that stands beside the model, and the change where there is one."""
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
