"""One self-contained page of all that a folder holds: recordings, fitted cuffs, assessment, and the hashes of them.

report.json in its folder lists every number of the page with its source. The text of the page follows from the files of
that folder alone, so that it can be rendered again and compared; its figures follow from the samples, too.
As a PDF it is printed by an installed Chromium, Chrome or Edge that Playwright drives.
"""

from __future__ import annotations

import json
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, TypeVar

from jinja2 import BytecodeCache, Environment, FileSystemLoader, StrictUndefined
from jinja2.bccache import Bucket
from pydantic import TypeAdapter

from documents.interval import counted
from documents.message import Message
from documents.plain_data import read_json
from documents.validation import refused_as
from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import CUFFS_FILE, cuffs_document, read_cuffs_document, wearable_cuffs
from fitting.cuffs.wearable_cuff import QUANTITIES, UNITS, Cuff
from fitting.results.codes import Standing
from fitting.results.cuffs_schema import CuffsDocument
from recordings.manifest import DataOrigin
from station.assessment.assessment_file import AssessmentDocument, read_assessment
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.charts.svg import with_commands
from station.checksums import drafted, write_checksums, write_whole
from station.emg.emg_json import EMG_FILE, EmgDocument, read_emg_document
from station.errors import StationError
from station.files.chain import NUMBERS_FILE, REPORT_FILE, trace_chain
from station.fit import fit_session_folder
from station.folders import ensure_folder
from station.messages.setup_messages import FolderCode
from station.progress import Progress, silent
from station.recordings_of_session import motions_in, pulls_in, recordings_in
from station.report.assessment_section import assessment_section, effort_figures, suit_figures
from station.report.cuff_section import TrueCuff, cuff_figures, normative_section, reported_cuffs, shared_notes
from station.report.first_page import first_page
from station.report.numbers import NumberRegister, Provenance, figure, fixed, interval, length, located, worn
from station.report.pictures import Picture, PlannedPicture, draw_all
from station.report.report_file import FORMAT, ReportDocument, Source, numbers_text
from station.report.session_facts import recording_rows, session_facts
from station.report.wearer_section import emg_figures, emg_section, wearer_figures
from station.study.study_document import NORMATIVE_FILE

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Playwright


T = TypeVar("T")
Drawn = Mapping[str, Sequence[Picture]]
_HERE = Path(__file__).parent

EFFORT, MUSCLES, WEARER, EMG = "effort", "muscles", "wearer", "emg"
"""Sections with figures; every cuff has one, too."""
TRUTH_FILE = "simulated_truth.json"
"""Beside the recordings of simulated devices: what the simulated cuffs carried."""
MISSING_FILE = "missing.json"
"""Beside them where the report is not complete: a list of sentences, what is missing and why."""
PDF_FILE = "report.pdf"
PROGRAMS = ("chromium-headless-shell", "chromium", "chromium-browser", "google-chrome", "microsoft-edge")
"""On Linux by name, first the one without windows, which takes less time; elsewhere Playwright finds CHANNELS."""
CHANNELS = ("chrome", "msedge")
_TRUTH, _MISSING = TypeAdapter(dict[str, TrueCuff]), TypeAdapter(list[str])


class ReportError(StationError):
    """There is nothing to report; one sentence."""


@dataclass(frozen=True)
class Results:
    """Inputs of the text of a page.

    document: content of cuffs.json, or what a fit would write there, located; None without either
    assessment: located
    """

    folder: Path
    cuffs: Mapping[str, Cuff]
    document: CuffsDocument | None
    truth: dict[str, TrueCuff]
    assessment: AssessmentDocument | None
    emg: EmgDocument | None

    @property
    def origin(self) -> DataOrigin:
        """Of all that the page shows."""
        found = [fit.origin for fit in self.cuffs.values()]
        if self.assessment and self.assessment.origin in list(DataOrigin):
            found.append(DataOrigin(self.assessment.origin))
        if self.emg:
            found.append(self.emg.origin)
        return DataOrigin.joined(found)


def write_report(folder: Path, fitted: SessionFit | None = None, progress: Progress = silent) -> Path:
    """Writes report.html and report.json into the folder and returns the path of the page.

    fitted spares fitting the folder's recordings again. Raises ReportError for a folder without recordings and results.
    """
    ensure_folder(folder)
    if fitted is None and folder.is_dir() and pulls_in(folder):
        fitted = fit_session_folder(folder, None, progress)
    results = read_results(folder, fitted)
    page, register = render(results, draw_all(_planned(results, fitted), progress))
    path, beside = folder / REPORT_FILE, folder / NUMBERS_FILE
    listed = ReportDocument(
        format=FORMAT,
        page=path.name,
        origin=results.origin,
        version=metadata.version("cuffstation"),
        inputs=_inputs(folder),
        numbers=register.numbers,
        figures=register.figures,
    )
    with drafted(beside) as numbers_draft, drafted(path) as draft:  # neither without the other
        numbers_draft.write_text(numbers_text(listed), encoding="utf-8", errors="replace")
        draft.write_bytes(page.encode(errors="replace"))
    write_checksums(path, beside)
    return path


def write_missing(folder: Path, missing: Sequence[str]) -> None:
    """Write what the report of a session lacks, in sentences; without any, remove what an earlier one lacked."""
    if missing or (folder / MISSING_FILE).is_file():
        write_whole(folder / MISSING_FILE, json.dumps(list(missing), indent=2, ensure_ascii=False) + "\n")


def read_results(folder: Path, fitted: SessionFit | None = None) -> Results:
    """The results of a folder; those of the cuffs from the fit, or else from cuffs.json.

    Raises ReportError without results, and the errors of the readers.
    """
    path = folder / CUFFS_FILE
    document = cuffs_document(fitted) if fitted else read_cuffs_document(path) if path.is_file() else None
    cuffs = wearable_cuffs(document) if document else {}
    if fitted is not None:
        cuffs = {name: fit.wearable() for name, fit in fitted.cuffs.items()}
    path = folder / ASSESSMENT_FILE
    assessment = read_assessment(path) if path.is_file() else None
    emg = read_emg_document(folder / EMG_FILE) if (folder / EMG_FILE).is_file() else None
    if not cuffs and not assessment and not emg:
        raise ReportError(Message(FolderCode.NOTHING_TO_REPORT, {"folder": str(folder)}))
    return Results(
        folder,
        cuffs,
        located(document, Source.of(CUFFS_FILE)) if document and cuffs else None,
        _read_optional(folder / TRUTH_FILE, _TRUTH) or {},
        located_assessment(assessment) if assessment else None,
        emg,
    )


def located_assessment(assessment: AssessmentDocument) -> AssessmentDocument:
    """assessment.json as the page shows it."""
    return located(assessment, Source.of(ASSESSMENT_FILE))


def render(results: Results, drawn: Drawn = MappingProxyType({})) -> tuple[str, NumberRegister]:
    """The page, and its numbers and figures by their ids; without drawings, the same numbers."""
    register = NumberRegister(Provenance(results.document, results.assessment))
    pictures = {
        section: register.add_figures(section, found, _series(section, results)) for section, found in drawn.items()
    }
    page = _environment(register).get_template("page.html").render(_context(results, pictures))
    return page, register


def _context(results: Results, pictures: Drawn) -> dict[str, Any]:
    """Variables of the templates."""
    folder, document, assessment, emg = results.folder, results.document, results.assessment, results.emg
    origin, chain = results.origin, trace_chain(folder, is_report_included=False)
    known = located(results.truth, Source.of(TRUTH_FILE))
    sentences = _read_optional(folder / MISSING_FILE, _MISSING) or []
    cuffs = reported_cuffs(results.cuffs, document, assessment, known, pictures)
    return {
        "folder": folder.resolve().name,
        "facts": session_facts(folder, recordings_in(folder), document.calibration if document else None, origin),
        "first": first_page(assessment, results.cuffs),
        "cuffs": cuffs,
        "shared_notes": shared_notes(cuffs),
        "effort": pictures.get(EFFORT, ()),
        "is_fitted": bool(results.cuffs),
        "origin": origin,
        "chain": chain,
        "doubts": [str(link) for link in chain if link.standing.is_break] + _contradictions(results.cuffs, assessment),
        "given": [str(link) for link in chain if link.standing is Standing.BY_HAND],
        "missing": located(sentences, Source.of(MISSING_FILE)),
        "recordings": recording_rows(folder, document),
        "assessment": assessment,
        "suit": assessment_section(assessment, pictures.get(MUSCLES, ())) if assessment else None,
        "wearer": pictures.get(WEARER, ()),
        "emg": emg_section(emg, pictures.get(EMG, ())) if emg else None,
        "normative": normative_section(folder, results.cuffs, origin),
        "version": metadata.version("cuffstation"),
    }


def _planned(results: Results, fitted: SessionFit | None) -> dict[str, Sequence[PlannedPicture]]:
    """Figures by section."""
    assessment, emg = results.assessment, results.emg
    return {
        EFFORT: effort_figures(assessment) if assessment else (),
        MUSCLES: suit_figures(assessment, results.folder) if assessment else (),
        WEARER: wearer_figures(results.folder),
        EMG: emg_figures(emg) if emg else (),
        **{
            f"cuff {name}": cuff_figures(fit, results.truth.get(name))
            for name, fit in (fitted.cuffs if fitted else {}).items()
        },
    }


def _series(section: str, results: Results) -> list[Source]:
    """Places of the series that the figures of a section show; those of a cuff show its samples, too."""
    cuffs, assessed = Source.of(CUFFS_FILE, "/cuffs"), Source.of(ASSESSMENT_FILE)
    if section == EFFORT:
        return [assessed.child(key) for key in ("rest_lengths_m", "cost")]
    if section == MUSCLES:
        keys = ("rest_lengths_m", "cost", "muscle_reduction", "postures", "emg")
        return [*(assessed.child(key) for key in keys), Source.of(ACTIVATIONS_FILE)]
    if section == WEARER:
        return [Source.of(path.name) for path in motions_in(results.folder)]
    if section == EMG:
        return [Source.of(EMG_FILE, "/trials"), Source.of(EMG_FILE, "/changes")]
    name = section.removeprefix("cuff ")
    return [cuffs.child(name), *(Source.of(file) for file in results.cuffs[name].sources)]


def _inputs(folder: Path) -> list[str]:
    """Files that the page is made of."""
    results = (CUFFS_FILE, ASSESSMENT_FILE, ACTIVATIONS_FILE, EMG_FILE, NORMATIVE_FILE)
    made_of = [*recordings_in(folder), *(folder / name for name in results)]
    return [path.name for path in made_of if path.is_file()]


def _contradictions(cuffs: Mapping[str, Cuff], assessment: AssessmentDocument | None) -> list[str]:
    """Sentences on cuffs whose figures in the assessment differ from those in the table of cuffs."""
    sentences = []
    for name, entries in (assessment.cuffs if assessment else {}).items():
        for quantity, key in QUANTITIES.items() if name in cuffs else ():
            shown, entry = getattr(cuffs[name], quantity), getattr(entries, key)
            if shown is None or entry.value is None or math.isclose(shown.value, entry.value, rel_tol=1e-9):
                continue
            by_hand = f", {Standing.BY_HAND}" if entry.source == Standing.BY_HAND else ""
            sentences.append(
                f"the muscles were solved with another {quantity} of cuff {name} than that in the table: "
                f"{entry.value:.6g} {UNITS[quantity]}{by_hand}, and the table has {shown.value:.6g}"
            )
    return sentences


def _read_optional(path: Path, kind: TypeAdapter[T]) -> T | None:
    """Content of a file beside the recordings, None without the file. Raises ReportError."""
    with refused_as(ReportError, path, FolderCode.FILE_BESIDE_UNUSABLE):
        return kind.validate_python(read_json(path)) if path.is_file() else None


class CompiledTemplates(BytecodeCache):
    """Compiled templates of this process: each page has its own environment, because it has its own register."""

    def __init__(self) -> None:
        self._code: dict[str, bytes] = {}

    def load_bytecode(self, bucket: Bucket) -> None:
        if code := self._code.get(bucket.key):
            bucket.bytecode_from_string(code)

    def dump_bytecode(self, bucket: Bucket) -> None:
        self._code[bucket.key] = bucket.bytecode_to_string()


_COMPILED = CompiledTemplates()


def _environment(register: NumberRegister) -> Environment:
    """Templates in which everything that is printed passes the register of numbers."""
    environment = Environment(
        loader=FileSystemLoader([_HERE, _HERE.parent / "charts"]),
        autoescape=True,
        undefined=StrictUndefined,
        bytecode_cache=_COMPILED,
        finalize=register.mark,
    )
    environment.filters |= {
        "interval": interval,
        "figure": figure,
        "worn": worn,
        "fixed": fixed,
        "number_of": length,
        "counted": counted,
        "commands": lambda sentence: with_commands(register.mark(sentence)),
    }
    return environment


class BrowserError(StationError):
    """No browser can print the page."""


def ensure_pdf() -> None:
    """Raises ModuleNotFoundError, before anything is fitted, without the extra `pdf`."""
    import playwright  # noqa: F401


def write_pdf(page: Path) -> Path:
    """Print report.html beside itself on A4 and return the path. Raises BrowserError without a browser."""
    from playwright.sync_api import Error, sync_playwright

    with sync_playwright() as playwright:
        browser = _launch(playwright, Error)
        try:
            tab = browser.new_page(java_script_enabled=False, offline=True)
            tab.goto(page.resolve().as_uri())
            tab.emulate_media(media="print", color_scheme="light")
            printed = tab.pdf(prefer_css_page_size=True, print_background=True, tagged=True, outline=True)
        finally:
            browser.close()
    path = page.with_name(PDF_FILE)
    write_whole(path, printed)
    write_checksums(path)
    return path


def browser_path() -> str | None:
    """The first of PROGRAMS that is installed; None without one."""
    return next(filter(None, map(shutil.which, PROGRAMS)), None)


def _launch(playwright: Playwright, error: type[Exception]) -> Browser:
    """The first browser that starts: an installed one, then Playwright's own."""
    found = browser_path()
    if found is not None:
        return playwright.chromium.launch(executable_path=found)
    reason = ""
    for channel in (*CHANNELS, None):
        try:
            return playwright.chromium.launch(channel=channel)
        except error as refused:
            reason = str(refused).splitlines()[0]
    raise BrowserError(Message(FolderCode.NO_BROWSER, {"reason": reason}))
