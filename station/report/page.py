"""One self-contained page of all that a folder holds: recordings, fitted cuffs, assessment, and the hashes of them.

report.json beside it lists every number of the page with its source.
"""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from pydantic import TypeAdapter, ValidationError

from documents.plain_data import PlainDataError, read_json
from documents.validation import describe_error
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import CUFFS_FILE, read_cuffs
from fitting.cuffs.cuffs_json import cuffs_json
from fitting.cuffs.wearable_cuff import QUANTITIES, UNITS, Cuff
from fitting.results.standing import Standing
from recordings.manifest import DataOrigin
from station.assessment.assessment_file import read_assessment
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.assessment.total_json import with_total_intervals
from station.checksums import sha256_of, write_checksums
from station.emg.emg_json import EMG_FILE, EmgDocument, read_emg_document
from station.errors import StationError
from station.files.chain import NUMBERS_FILE, REPORT_FILE, chain_of
from station.fit import fit_session_folder
from station.messages.html import with_commands
from station.messages.message import Message
from station.messages.setup_codes import FolderCode
from station.progress import Progress, silent
from station.recordings_of_session import pulls_in, recordings_in
from station.report.assessment_section import assessment_section, effort_figures, suit_figures
from station.report.cuff_section import Cuffs, ReportedCuff, TrueCuff, cuff_figures, overview_figure
from station.report.emg_section import emg_figures, emg_section
from station.report.first_page import summary_of
from station.report.located import LocatedObject, Source, located
from station.report.normative_section import normative_section
from station.report.number_register import NumberRegister
from station.report.number_texts import (
    entry_number,
    estimated,
    fixed,
    length,
    of_this_cuff,
    true_number,
    worn_number,
)
from station.report.pictures import Picture, PlannedFigure, draw_all
from station.report.provenance import Provenance
from station.report.report_file import FORMAT, PageEntry, ReportDocument, numbers_text
from station.report.session_facts import session_facts
from station.study.normative_file import NORMATIVE_FILE
from station.whole_file import drafted, write_whole

T = TypeVar("T")
_HERE = Path(__file__).parent

OVERVIEW, EFFORT, MUSCLES, EMG = "overview", "effort", "muscles", "emg"
"""Sections with figures; every cuff has one, too."""
OVERVIEW_CAPTION = "Stiffness, damping and migration of all cuffs with 95 % intervals"
TRUTH_FILE = "simulated_truth.json"
"""Beside the recordings of simulated devices: what the simulated cuffs carried."""
MISSING_FILE = "missing.json"
"""Beside them where the report is not complete: a list of sentences, what is missing and why."""


class ReportError(StationError):
    """There is nothing to report; one sentence."""


@dataclass(frozen=True)
class Results:
    """What a page is made of: the fit of the recordings or cuffs.json, and the other results in the folder.

    document: content of cuffs.json, or what a fit would write there, empty without either
    assessment: located, with the intervals of total uncertainty where people were drawn
    """

    folder: Path
    fitted: SessionFit | None
    cuffs: Cuffs
    document: LocatedObject
    truth: dict[str, TrueCuff]
    assessment: Mapping[str, Any] | None
    emg: EmgDocument | None

    @property
    def origin(self) -> DataOrigin:
        """Of all that the page shows."""
        found = [fit.origin for fit in self.cuffs.values()]
        if self.assessment and self.assessment.get("origin") in list(DataOrigin):
            found.append(DataOrigin(self.assessment["origin"]))
        if self.emg:
            found.append(self.emg.origin)
        return DataOrigin.joined(found)


def write_report(folder: Path, fitted: SessionFit | None = None, progress: Progress = silent) -> Path:
    """Writes report.html and report.json into the folder and returns the path of the page.

    fitted spares fitting the folder's recordings again. Raises ReportError for a folder without recordings and results.
    """
    if fitted is None and folder.is_dir() and pulls_in(folder):
        fitted = fit_session_folder(folder, None, progress)
    results = _read_results(folder, fitted)
    drawn = draw_all(_planned(results), progress)
    documents = {CUFFS_FILE: results.document, ASSESSMENT_FILE: results.assessment}
    register = NumberRegister(Provenance(results.document, results.assessment), documents)
    pictures = {
        section: register.add_figures(section, found, _series(section, results)) for section, found in drawn.items()
    }
    inputs = _inputs(folder)
    page = _environment(register).get_template("page.html").render(_context(results, pictures))
    path, beside = folder / REPORT_FILE, folder / NUMBERS_FILE
    content = page.encode(errors="replace")
    listed = ReportDocument(
        format=FORMAT,
        page=PageEntry(file=path.name, sha256=hashlib.sha256(content).hexdigest()),
        origin=results.origin,
        version=metadata.version("cuffstation"),
        inputs=inputs,
        numbers=register.numbers,
        figures=register.figures,
    )
    with drafted(beside) as numbers_draft, drafted(path) as draft:  # neither without the other
        numbers_draft.write_text(numbers_text(listed), encoding="utf-8", errors="replace")
        draft.write_bytes(content)
    write_checksums(path, beside)
    return path


def write_missing(folder: Path, missing: Sequence[str]) -> None:
    """Write what the report of a session lacks, in sentences; without any, remove what an earlier one lacked."""
    if missing or (folder / MISSING_FILE).is_file():
        write_whole(folder / MISSING_FILE, json.dumps(list(missing), indent=2, ensure_ascii=False) + "\n")


def _read_results(folder: Path, fitted: SessionFit | None) -> Results:
    cuffs: Cuffs = fitted.cuffs if fitted else _cuffs_of(folder)
    path = folder / ASSESSMENT_FILE
    assessment = located(read_assessment(path), Source(ASSESSMENT_FILE)) if path.is_file() else None
    emg = read_emg_document(folder / EMG_FILE) if (folder / EMG_FILE).is_file() else None
    if not cuffs and not assessment and not emg:
        raise ReportError(Message(FolderCode.NOTHING_TO_REPORT, {"folder": str(folder)}))
    document = json.loads(cuffs_json(fitted)) if fitted else read_json(folder / CUFFS_FILE) if cuffs else {}
    return Results(
        folder,
        fitted,
        cuffs,
        located(document, Source(CUFFS_FILE)),
        _beside(folder / TRUTH_FILE, _TRUTH) or {},
        with_total_intervals(assessment) if assessment else None,
        emg,
    )


def _context(results: Results, pictures: Mapping[str, Sequence[Picture]]) -> dict[str, Any]:
    """What the templates show."""
    folder, document, assessment, emg = results.folder, results.document, results.assessment, results.emg
    origin, chain = results.origin, chain_of(folder, is_report_included=False)
    known = located({name: cuff.model_dump() for name, cuff in results.truth.items()}, Source(TRUTH_FILE))
    entries = document.get("cuffs", {})
    return {
        "folder": folder.resolve().name,
        "facts": session_facts(folder, recordings_in(folder), document.get("calibration"), origin),
        "summary": summary_of(assessment, results.cuffs),
        "cuffs": [
            ReportedCuff(fit, entries[name], known.get(name), pictures[f"cuff {name}"])
            for name, fit in results.cuffs.items()
        ],
        "overview": pictures[OVERVIEW],
        "has_truth": bool(known),
        "origin": origin,
        "chain": chain,
        "doubts": [str(link) for link in chain if link.standing.is_break] + _contradictions(results.cuffs, assessment),
        "given": [str(link) for link in chain if link.standing is Standing.BY_HAND],
        "missing": located(_beside(folder / MISSING_FILE, _MISSING) or [], Source(MISSING_FILE)),
        "trials": [trial for cuff in entries.values() for trial in cuff.get("trials", ())] if results.fitted else [],
        "rejected": document.get("rejected", ()) if results.fitted else (),
        "assessment": assessment,
        "suit": assessment_section(assessment, pictures[EFFORT], pictures[MUSCLES]) if assessment else None,
        "emg": emg_section(emg, pictures[EMG]) if emg else None,
        "normative": normative_section(folder, results.cuffs, origin),
        "version": metadata.version("cuffstation"),
    }


def _planned(results: Results) -> dict[str, Sequence[PlannedFigure]]:
    """Figures by section."""
    cuffs, assessment, emg = results.cuffs, results.assessment, results.emg
    drawing = partial(overview_figure, cuffs, results.truth)
    overview = PlannedFigure(drawing, OVERVIEW_CAPTION, is_wide=True, is_printed=True)
    return {
        OVERVIEW: [overview] if cuffs else (),
        EFFORT: effort_figures(assessment) if assessment else (),
        MUSCLES: suit_figures(assessment, results.folder) if assessment else (),
        EMG: emg_figures(emg) if emg else (),
        **{f"cuff {name}": cuff_figures(fit) if isinstance(fit, CuffFit) else () for name, fit in cuffs.items()},
    }


def _series(section: str, results: Results) -> list[Source]:
    """Places of the series that the figures of a section show; those of a cuff show its samples, too."""
    cuffs, assessed = Source(CUFFS_FILE, "/cuffs"), Source(ASSESSMENT_FILE)
    if section == OVERVIEW:
        return [cuffs.child(name).child(key) for name in results.cuffs for key in QUANTITIES.values()]
    if section == EFFORT:
        return [assessed.child(key) for key in ("rest_lengths_m", "cost")]
    if section == MUSCLES:
        keys = ("rest_lengths_m", "cost", "muscle_reduction", "postures", "emg")
        return [*(assessed.child(key) for key in keys), Source(ACTIVATIONS_FILE)]
    if section == EMG:
        return [Source(EMG_FILE, "/trials"), Source(EMG_FILE, "/changes")]
    name = section.removeprefix("cuff ")
    found = results.cuffs[name]
    return [cuffs.child(name), *(Source(file) for file in found.sources)]


def _inputs(folder: Path) -> dict[str, str]:
    """File → SHA-256 of all that the page is made of."""
    results = (CUFFS_FILE, ASSESSMENT_FILE, ACTIVATIONS_FILE, EMG_FILE, NORMATIVE_FILE)
    made_of = [*recordings_in(folder), *(folder / name for name in results)]
    return {path.name: sha256_of(path) for path in made_of if path.is_file()}


def _contradictions(cuffs: Cuffs, assessment: Mapping[str, Any] | None) -> list[str]:
    """Where the assessment wears other figures than those in the table of cuffs, in sentences."""
    sentences = []
    for name, worn in ((assessment or {}).get("cuffs") or {}).items():
        for quantity, key in QUANTITIES.items() if name in cuffs else ():
            shown, entry = getattr(cuffs[name], quantity), worn.get(key) or {}
            value = entry.get("value")
            if shown is None or value is None or math.isclose(shown.value, value, rel_tol=1e-9):
                continue
            by_hand = f", {Standing.BY_HAND}" if entry.get("source") == Standing.BY_HAND else ""
            sentences.append(
                f"the muscles were solved with another {quantity} of cuff {name} than that in the table: "
                f"{value:.6g} {UNITS[quantity]}{by_hand}, and the table has {shown.value:.6g}"
            )
    return sentences


def _cuffs_of(folder: Path) -> dict[str, Cuff]:
    path = folder / "cuffs.json"
    return read_cuffs(path) if path.is_file() else {}


_TRUTH, _MISSING = TypeAdapter(dict[str, TrueCuff]), TypeAdapter(list[str])


def _beside(path: Path, kind: TypeAdapter[T]) -> T | None:
    """Content of a file beside the recordings, None without the file."""
    if not path.is_file():
        return None
    try:
        return kind.validate_python(read_json(path))
    except OSError as error:
        raise ReportError(f"{path} cannot be read: {error.strerror or error}") from error
    except ValidationError as error:
        raise ReportError(f"{path}: {describe_error(error)}; make it again") from error
    except PlainDataError as error:
        raise ReportError(f"{path} {error}; make it again") from error


def _environment(register: NumberRegister) -> Environment:
    """Templates in which everything that is printed passes the register of numbers."""
    environment = Environment(
        loader=FileSystemLoader([_HERE, _HERE.parent / "charts"]),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=register.mark,
    )
    environment.filters |= {
        "spoken": estimated,
        "of_cuff": of_this_cuff,
        "figure": entry_number,
        "worn": worn_number,
        "beside": true_number,
        "fixed": fixed,
        "number_of": length,
        "commands": lambda sentence: with_commands(register.mark(sentence)),
    }
    return environment
