"""A study as tables for a terminal."""

from __future__ import annotations

from collections.abc import Iterator

from rich.console import Console

from fitting.study.variance_components import ComponentOutcome
from recordings.manifest import DataOrigin
from station.folded_table import FoldedTable
from station.study.study_document import (
    OPEN,
    SHOWN,
    ComponentEntry,
    QuantityEntry,
    StudyDocument,
    shown_effect,
    shown_figure,
    shown_range,
)

COMPONENTS = ("volunteer", "donning", "repeat", "operator")


def print_study(document: StudyDocument, console: Console) -> None:
    """Means with prediction intervals, variance components, reliability, comparisons."""
    if document.origin is DataOrigin.SIMULATED:
        console.print("SIMULATED data: the devices of the recordings report that they are simulated")
    for table in (_means(document), _components(document), _reliability(document), _comparisons(document)):
        if table.row_count:
            console.print(table)


def shown_component(component: ComponentEntry, scale: float) -> str:
    """Standard deviation with its interval, or why there is none."""
    match component.outcome:
        case ComponentOutcome.ONE_LEVEL:
            return "one level"
        case ComponentOutcome.CONFOUNDED:
            return f"in {', '.join(component.confounded_with)}"
    return shown_figure(component.sd, scale)


def _rows(document: StudyDocument) -> Iterator[tuple[str, str, QuantityEntry]]:
    for cuff, quantities in document.cuffs.items():
        for quantity, found in quantities.items():
            yield cuff, f"{quantity} [{SHOWN[quantity][1]}]", found


def _means(document: StudyDocument) -> FoldedTable:
    title = "Mean over volunteers (95 % interval), and where 95 % of new volunteers are expected"
    table = FoldedTable("cuff", "quantity", "volunteers", "mean", "prediction", title=title, title_justify="left")
    for cuff, name, found in _rows(document):
        quantity = name.split()[0]
        predicted = shown_range(found.prediction.ci95, quantity) if found.prediction else OPEN
        count = str(len(found.volunteers))
        table.add_row(cuff, name, count, shown_effect(found.mean, quantity), predicted)
    return table


def _components(document: StudyDocument) -> FoldedTable:
    title = "Standard deviation between (95 % interval), and of the fit of one repeat"
    table = FoldedTable("cuff", "quantity", *COMPONENTS, "fit", title=title, title_justify="left")
    for cuff, name, found in _rows(document):
        if not found.components:
            continue
        scale = SHOWN[name.split()[0]][0]
        cells = [shown_component(found.components[component], scale) for component in COMPONENTS]
        table.add_row(cuff, name, *cells, f"{scale * (found.noise_sd or 0.0):.2g}")
    return table


def _reliability(document: StudyDocument) -> FoldedTable:
    title = "Reliability of one repeat in one donning"
    table = FoldedTable(
        "cuff", "quantity", "ICC(2,1)", "SEM", "minimal change", "outcome", title=title, title_justify="left"
    )
    for cuff, name, found in _rows(document):
        if found.reliability is None:
            continue
        scale, one = SHOWN[name.split()[0]][0], found.reliability
        sem, mdc = shown_figure(one.sem, scale), shown_figure(one.mdc, scale)
        table.add_row(cuff, name, shown_figure(one.icc, 1.0, 2), sem, mdc, one.outcome.value.replace("_", " "))
    return table


def _comparisons(document: StudyDocument) -> FoldedTable:
    title = "Difference of cuffs over volunteers (95 % interval)"
    table = FoldedTable("cuffs", "quantity", "volunteers", "difference", title=title, title_justify="left")
    for found in document.comparisons:
        name = f"{found.quantity} [{SHOWN[found.quantity][1]}]"
        difference = shown_effect(found.difference, found.quantity) if found.difference else found.outcome.value
        cuffs = f"{found.second} − {found.first}"
        table.add_row(cuffs, name, str(found.volunteers), difference.replace("_", " "))
    return table
