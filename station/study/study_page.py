"""A study as tables for a terminal, and study.html: tables, forest plots and Bland–Altman plots on one page.

A forest plot shows the volunteers, a Bland–Altman plot pairs of measurements.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from rich.console import Console

from documents.interval import counted
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.study.cuff_study import Agreement, ComponentSpread, CuffStudy, Measure
from fitting.study.variance_components import ComponentOutcome
from recordings.manifest import DataOrigin
from station.charts.marks import Chart, Intervals, Mark, Panel, Points, Rule, Strip, chart, values
from station.charts.svg import draw, with_commands
from station.checksums import write_checksums, write_whole
from station.cuff_text import SHOWN
from station.folded_table import FoldedTable
from station.study.study_document import OPEN, StudyDocument, shown_effect, shown_figure, shown_range

STUDY_PAGE = "study.html"
_HERE = Path(__file__).parent
ROW = 18.0
"""Height [px] of a volunteer in a forest plot."""
FRAME = 70.0
"""Height [px] of the axis and its name."""
COMPONENTS = ("volunteer", "donning", "repeat", "operator")


def write_study_page(folder: Path, document: StudyDocument) -> Path:
    """Write study.html into the folder."""
    page = (
        _environment()
        .get_template(STUDY_PAGE)
        .render(
            study=document,
            volunteers=len({session.volunteer for session in document.sessions}),
            sections=_sections(document),
            comparisons={
                quantity: [found for found in document.comparisons if found.quantity == quantity]
                for quantity in QUANTITIES
            },
            components=COMPONENTS,
            left_out=list(map(str, document.left_out)),
            unit=lambda quantity: SHOWN[quantity].unit,
            scale=lambda quantity: SHOWN[quantity].scale,
            effect=shown_effect,
            figure=shown_figure,
            component=shown_component,
            predicted=_predicted,
            forest=_forest,
            bland_altman=_bland_altman,
        )
    )
    write_whole(folder / STUDY_PAGE, page)
    write_checksums(folder / STUDY_PAGE)
    return folder / STUDY_PAGE


@cache
def _environment() -> Environment:
    loader = FileSystemLoader([_HERE, _HERE.parent / "charts"])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["commands"] = with_commands
    environment.filters["counted"] = counted
    return environment


def _sections(document: StudyDocument) -> dict[str, dict[str, CuffStudy]]:
    """Quantity → cuff → statistics."""
    found: dict[str, dict[str, CuffStudy]] = {}
    for cuff, quantities in document.cuffs.items():
        for quantity, entry in quantities.items():
            found.setdefault(quantity, {})[cuff] = entry
    return found


def _predicted(found: CuffStudy, quantity: str) -> str:
    return shown_range(found.prediction.ci95, quantity) if found.prediction else OPEN


def _forest(found: CuffStudy, quantity: str, cuff: str) -> str:
    return draw(forest_chart(found, quantity), f"{quantity} of {cuff} by volunteer")


def _bland_altman(found: Agreement, name: str, quantity: str, cuff: str) -> str:
    return draw(agreement_chart(found, name, quantity), f"agreement of {quantity} of {cuff}, {name}")


def forest_chart(found: CuffStudy, quantity: str) -> Chart:
    """Every volunteer with a 95 % interval; the mean as a line, the prediction interval as a strip."""
    scale, unit = SHOWN[quantity].scale, SHOWN[quantity].unit
    names = tuple(mean.volunteer for mean in found.volunteers)
    places = values(range(len(names)))
    centres = values([scale * mean.value for mean in found.volunteers])
    ends = scale * values([mean.ci95 for mean in found.volunteers]).reshape(-1, 2)
    marks: list[Mark] = []
    if found.prediction:
        low, high = (scale * end for end in found.prediction.ci95)
        marks.append(Strip(low, high, "quiet", "95 % of new volunteers", is_upright=True))
    if found.mean:
        low, high = (scale * end for end in found.mean.ci95)
        marks.append(Strip(low, high, "c1", "mean, 95 %", is_upright=True))
        marks.append(Rule(scale * found.mean.value, "c1", is_upright=True))
    marks += [Intervals(places, ends[:, 0], ends[:, 1], "ink", is_upright=False), Points(centres, places, "ink")]
    height = FRAME + ROW * (len(names) + 1)
    limits = (-0.7, len(names) - 0.3)
    return chart(Panel(tuple(marks), f"{quantity} [{unit}]", y_names=names, y_limits=limits, height=height))


def agreement_chart(found: Agreement, name: str, quantity: str) -> Chart:
    """Difference over mean of the pairs, bias, limits of agreement with their 95 % intervals."""
    scale, unit = SHOWN[quantity].scale, SHOWN[quantity].unit
    marks: list[Mark] = [Rule(0.0, "quiet", dash="dotted")]
    for figure, label in ((found.lower_limit, "95 % limits of agreement"), (found.upper_limit, "")):
        marks += _limit(figure, scale, label)
    if found.bias.value is not None:
        marks.append(Rule(scale * found.bias.value, "c1", "bias"))
    marks.append(Points(scale * values(found.means), scale * values(found.differences), "ink"))
    return chart(Panel(tuple(marks), f"mean of both [{unit}]", f"difference [{unit}]", name))


def _limit(figure: Measure, scale: float, label: str) -> list[Mark]:
    if figure.value is None or figure.ci95 is None:
        return []
    low, high = (scale * (end or 0.0) for end in figure.ci95)
    return [Strip(low, high, "c2"), Rule(scale * figure.value, "c2", label, "dashed")]


def print_study(document: StudyDocument, console: Console) -> None:
    """Means with prediction intervals, variance components, reliability, comparisons."""
    if document.origin is DataOrigin.SIMULATED:
        console.print("SIMULATED data: the devices of the recordings report that they are simulated")
    for table in (_means(document), _components(document), _reliability(document), _comparison_rows(document)):
        if table.row_count:
            console.print(table)


def shown_component(component: ComponentSpread, scale: float) -> str:
    """Standard deviation with its interval, or why there is none."""
    match component.outcome:
        case ComponentOutcome.ONE_LEVEL:
            return "one level"
        case ComponentOutcome.CONFOUNDED:
            return f"in {', '.join(component.confounded_with)}"
    return shown_figure(component.sd, scale)


def _rows(document: StudyDocument) -> Iterator[tuple[str, str, CuffStudy]]:
    for cuff, quantities in document.cuffs.items():
        for quantity, found in quantities.items():
            yield cuff, f"{quantity} [{SHOWN[quantity].unit}]", found


def _means(document: StudyDocument) -> FoldedTable:
    title = "Mean over volunteers (95 % interval), and where 95 % of new volunteers are expected"
    table = FoldedTable("cuff", "quantity", "volunteers", "mean", "prediction", title=title, title_justify="left")
    for cuff, name, found in _rows(document):
        quantity = name.split()[0]
        predicted = shown_range(found.prediction.ci95, quantity) if found.prediction else OPEN
        count = str(len(found.volunteers) or "none")
        table.add_row(cuff, name, count, shown_effect(found.mean, quantity), predicted)
    return table


def _components(document: StudyDocument) -> FoldedTable:
    title = "Standard deviation between (95 % interval), and of the fit of one repeat"
    table = FoldedTable("cuff", "quantity", *COMPONENTS, "fit", title=title, title_justify="left")
    for cuff, name, found in _rows(document):
        if not found.components:
            continue
        scale = SHOWN[name.split()[0]].scale
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
        scale, one = SHOWN[name.split()[0]].scale, found.reliability
        sem, mdc = shown_figure(one.sem, scale), shown_figure(one.mdc, scale)
        table.add_row(cuff, name, shown_figure(one.icc, 1.0, 2), sem, mdc, one.outcome.value.replace("_", " "))
    return table


def _comparison_rows(document: StudyDocument) -> FoldedTable:
    title = "Difference of cuffs over volunteers (95 % interval)"
    table = FoldedTable("cuffs", "quantity", "volunteers", "difference", title=title, title_justify="left")
    for found in document.comparisons:
        name = f"{found.quantity} [{SHOWN[found.quantity].unit}]"
        difference = shown_effect(found.difference, found.quantity) if found.difference else found.outcome.value
        cuffs = f"{found.second} − {found.first}"
        table.add_row(cuffs, name, str(found.volunteers or "none with both"), difference.replace("_", " "))
    return table
