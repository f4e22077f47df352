"""The cuffs of the report: the table of the first page, a section of figures per cuff, and the volunteers of a study.

The volunteers are those of normative.json in the session's folder.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pydantic import BaseModel

from documents.interval import significant_decimals
from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.cuffs.wearable_cuff import QUANTITIES, Cuff
from fitting.results.cuffs_schema import CuffEntry, CuffsDocument, TensorEntry
from recordings.manifest import DataOrigin
from station.assessment.assessment_file import AssessmentDocument
from station.assessment.assessment_json import RIGID, NumberEntry, WornCuffEntry
from station.checksums import write_checksums, write_whole
from station.cuff_text import SHOWN, of_cuff
from station.report.fit_figures import checks_figure, fit_figure
from station.report.numbers import Number, Shown, ends, figure, fixed, interval, located, mean_with, saving, worn
from station.report.pictures import Picture, PlannedPicture
from station.report.report_file import Source
from station.study.study_document import NORMATIVE_FILE, NormativeEntry, NormativePlace, QuantityName, read_normative

Cuffs = Mapping[str, Cuff]

FITTED = "Held loads and pooled stiffness; tangent stiffness; force beyond the spring over velocity, and pooled damper"
CHECKS = (
    "Checks with 95 % intervals: single repeats; complex stiffness K* = k + i 2πf c over frequency; residual force, "
    "its autocorrelation and quantiles"
)
PLACES = {
    NormativePlace.BELOW: "below the interval",
    NormativePlace.WITHIN: "within the interval",
    NormativePlace.ABOVE: "above the interval",
}


class TrueCuff(BaseModel):
    """True parameters of a simulated cuff."""

    stiffness_n_per_m: float
    damping_n_s_per_m: float
    migration_m: float


@dataclass(frozen=True)
class ReportedCuff:
    """One cuff on the page.

    figures, true  texts of k, c and migration, and of the true ones of a simulated cuff
    best_length, at_best, at_reference  where it saves most, and what it saves; "" of another than an arm cuff
    """

    name: str
    entry: CuffEntry | None
    figures: Sequence[Shown]
    true: Sequence[Number]
    best_length: Shown
    at_best: Shown
    at_reference: Shown
    pictures: Sequence[Picture]

    @property
    def notes(self) -> Sequence[str]:
        return self.entry.notes if self.entry else ()

    @property
    def tensors(self) -> list[tuple[str, str, TensorEntry]]:
        """Those that were identified, with their names and units."""
        if self.entry is None:
            return []
        stiffness, damping = self.entry.stiffness_tensor_n_per_m, self.entry.damping_tensor_n_s_per_m
        entries = (("Stiffness", "N/m", stiffness), ("Damping", "N s/m", damping))
        return [(what, unit, tensor) for what, unit, tensor in entries if tensor and tensor.value]


def reported_cuffs(
    cuffs: Cuffs,
    document: CuffsDocument | None,
    assessment: AssessmentDocument | None,
    known: Mapping[str, TrueCuff],
    pictures: Mapping[str, Sequence[Picture]],
) -> list[ReportedCuff]:
    """The cuffs of cuffs.json (document), or those that the assessment has worn; known: true ones by name."""
    entries = document.cuffs if document else {}
    worn_cuffs = assessment.cuffs if assessment else {}
    return [
        ReportedCuff(
            name,
            entries.get(name),
            [_shown(cuffs.get(name), worn_cuffs.get(name), quantity) for quantity in SHOWN],
            [_true(known[name], cuffs.get(name), quantity) for quantity in SHOWN] if name in known else (),
            *suit_effect(assessment, name),
            pictures.get(f"cuff {name}", ()),
        )
        for name in entries or worn_cuffs
    ]


def shared_notes(cuffs: Sequence[ReportedCuff]) -> list[str]:
    """Notes that all cuffs have, for which one place suffices; none for a single cuff."""
    if len(cuffs) < 2:
        return []
    return [note for note in cuffs[0].notes if all(note in cuff.notes for cuff in cuffs)]


def suit_effect(assessment: AssessmentDocument | None, cuff: str) -> tuple[Shown, Shown, Shown]:
    """The best rest length with this arm cuff, migration and compliance, what it saves there, and at the reference.

    Of rigid cuffs by their name.
    """
    if assessment is None or cuff not in (RIGID, *assessment.cost.arms):
        return "", "", ""
    best, reference = assessment.optimum.of(cuff), assessment.at_rigid_optimum.of(cuff)
    return figure(best.rest_length_m), saving(best.normalised_cost), saving(reference)


def cuff_estimate(fit: Cuff, quantity: str) -> NumberEntry | None:
    """Stiffness, damping or migration with its interval and its place in cuffs.json, identified or not.

    A file by hand may have a number alone in this place.
    """
    estimate, source = getattr(fit, quantity), Source.of(CUFFS_FILE, "/cuffs").child(fit.name)
    if estimate is None:
        return None
    if quantity in fit.missing:
        source = source.child("not_identified")
    number = NumberEntry(value=estimate.value, ci95=list(estimate.ci95))
    return located(number, source.child(QUANTITIES[quantity]))


def cuff_figures(fit: CuffFit, truth: TrueCuff | None = None) -> list[PlannedPicture]:
    """Of one cuff: its fit, and what checks it."""
    found = [fit.pulls[file] for file in fit.sources if file in fit.pulls]
    static = [curves for curves in found if curves.pull.trial.test == "static"]
    dynamic = [curves for curves in found if curves.pull.trial.test == "dynamic"]
    figures = []
    if static or dynamic:
        figures.append(PlannedPicture(partial(fit_figure, fit, static, dynamic), FITTED, is_wide=True, is_printed=True))
        true = truth.model_dump() if truth else {}
        figures.append(PlannedPicture(partial(checks_figure, fit, dynamic, true), CHECKS, is_wide=True))
    return figures


def _shown(fit: Cuff | None, in_suit: WornCuffEntry | None, quantity: str) -> Shown:
    """With a remark if it is given by hand, or not identified; as worn by the assessment without cuffs.json."""
    scale, digits = SHOWN[quantity].scale, SHOWN[quantity].most_digits
    if fit is None:
        return worn(getattr(in_suit, QUANTITIES[quantity], None), scale, digits)
    shown = interval(cuff_estimate(fit, quantity), scale, digits)
    return shown if isinstance(shown, str) else shown.within(of_cuff(fit, quantity, "{}"))


def _true(known: TrueCuff, fit: Cuff | None, quantity: str) -> Number:
    """With as many digits as the estimate above it."""
    estimate, scale = getattr(fit, quantity, None), SHOWN[quantity].scale
    digits = min(significant_decimals(estimate.ci95 if estimate else None, scale), SHOWN[quantity].most_digits)
    return fixed(getattr(known, QUANTITIES[quantity]), scale, digits)


@dataclass(frozen=True)
class NormativeRow:
    """One quantity of one cuff, in words; interval: 95 % prediction interval of a new volunteer in one donning."""

    cuff: str
    quantity: str
    own: Shown
    mean: Shown
    interval: Number
    place: str
    volunteers: int


@dataclass(frozen=True)
class NormativeSection:
    """has_same_origin: whether study and session are both measured, or both simulated."""

    rows: tuple[NormativeRow, ...]
    origin: DataOrigin
    has_same_origin: bool


def normative_section(folder: Path, cuffs: Cuffs, origin: DataOrigin) -> NormativeSection | None:
    """None without the file. Raises StudyError for one that `station study` would not write."""
    path = folder / NORMATIVE_FILE
    if not path.is_file():
        return None
    table = located(read_normative(path), Source.of(NORMATIVE_FILE))
    rows = tuple(row for name, fit in cuffs.items() for row in _rows(fit, table.cuffs.get(name) or {}))
    return NormativeSection(rows, table.origin, table.origin == origin)


def adopt_normative(table: Path, folder: Path) -> None:
    """Copy the table of a study into the session's folder, so that the report can be made and verified there.

    Raises StudyError for a file that is no such table.
    """
    read_normative(table)
    copy = folder / NORMATIVE_FILE
    if not copy.exists() or not copy.samefile(table):
        write_whole(copy, table.read_bytes())
    write_checksums(copy)


def _rows(fit: Cuff, entries: Mapping[QuantityName, NormativeEntry]) -> Iterator[NormativeRow]:
    for quantity, entry in entries.items():
        value = getattr(fit, quantity)
        scale = SHOWN[quantity].scale
        yield NormativeRow(
            fit.name,
            f"{quantity} [{SHOWN[quantity].unit}]",
            interval(cuff_estimate(fit, quantity), scale),
            mean_with(entry.mean, entry.mean_ci95, scale),
            ends(entry.prediction95, scale),
            PLACES[entry.place(value.value)] if value else "",
            entry.volunteers,
        )
