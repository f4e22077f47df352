"""study.html: tables, forest plots and Bland–Altman plots of a study on one page."""

from __future__ import annotations

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from fitting.cuffs.wearable_cuff import QUANTITIES
from station.charts.svg import draw
from station.checksums import write_checksums
from station.messages.html import with_commands
from station.messages.message import Message
from station.study.study_document import AgreementEntry, ComparisonEntry, QuantityEntry, StudyDocument
from station.study.study_figures import agreement_chart, forest_chart
from station.study.study_table import COMPONENTS, shown_component
from station.study.units import OPEN, SHOWN, shown_effect, shown_figure, shown_range
from station.whole_file import write_whole

STUDY_PAGE = "study.html"
_HERE = Path(__file__).parent


def write_study_page(folder: Path, document: StudyDocument) -> Path:
    """Write study.html into the folder."""
    page = (
        _environment()
        .get_template(STUDY_PAGE)
        .render(
            study=document,
            volunteers=len({session.volunteer for session in document.sessions}),
            sections=_sections(document),
            comparisons={quantity: _comparisons(document, quantity) for quantity in QUANTITIES},
            components=COMPONENTS,
            left_out=[str(Message(entry.code, entry.figures)) for entry in document.left_out],
            unit=lambda quantity: SHOWN[quantity][1],
            scale=lambda quantity: SHOWN[quantity][0],
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


def _environment() -> Environment:
    loader = FileSystemLoader([_HERE, _HERE.parent / "charts"])
    environment = Environment(
        loader=loader, autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["commands"] = with_commands
    return environment


def _sections(document: StudyDocument) -> dict[str, dict[str, QuantityEntry]]:
    """Quantity → cuff → statistics."""
    found: dict[str, dict[str, QuantityEntry]] = {}
    for cuff, quantities in document.cuffs.items():
        for quantity, entry in quantities.items():
            found.setdefault(quantity, {})[cuff] = entry
    return found


def _comparisons(document: StudyDocument, quantity: str) -> list[ComparisonEntry]:
    return [found for found in document.comparisons if found.quantity == quantity]


def _predicted(found: QuantityEntry, quantity: str) -> str:
    return shown_range(found.prediction.ci95, quantity) if found.prediction else OPEN


def _forest(found: QuantityEntry, quantity: str, cuff: str) -> str:
    return draw(forest_chart(found, quantity), f"{quantity} of {cuff} by volunteer")


def _bland_altman(found: AgreementEntry, name: str, quantity: str, cuff: str) -> str:
    return draw(agreement_chart(found, name, quantity), f"agreement of {quantity} of {cuff}, {name}")
