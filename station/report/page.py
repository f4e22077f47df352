"""One self-contained page of all that a folder holds: recordings, fitted cuffs, assessment, and the hashes of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
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
from fitting.cuffs.wearable_cuff import QUANTITIES, UNITS, WearableCuff
from fitting.results.seal import Standing
from recordings.manifest import DataOrigin
from station.assessment.assessment_file import read_assessment
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.assessment.total_json import with_total_intervals
from station.checksums import sha256_of, write_checksums
from station.emg.emg_json import EMG_FILE, EmgDocument, read_emg_document
from station.errors import StationError
from station.files.chain import REPORT_FILE, chain_of
from station.fit import fit_session_folder, pulls_in, recordings_in
from station.interval import of_cuff
from station.messages.message import Message
from station.messages.setup_codes import FolderCode
from station.progress import Progress, silent
from station.report.assessment_section import assessment_section, effort_figures, suit_figures
from station.report.cuff_section import Cuffs, ReportedCuff, TrueCuff, cuff_figures, overview_figure
from station.report.emg_section import emg_figures, emg_section
from station.report.first_page import summary_of
from station.report.normative_section import normative_section
from station.report.number_texts import entry_text, estimate_text, true_text, with_commands, worn_text
from station.report.pictures import PlannedFigure, draw_all
from station.report.session_facts import session_facts
from station.study.normative_file import NORMATIVE_FILE
from station.whole_file import write_whole

T = TypeVar("T")

OVERVIEW, EFFORT, MUSCLES, EMG = "overview", "effort", "muscles", "emg"
"""Sections with figures; every cuff has one, too."""
OVERVIEW_CAPTION = "Stiffness, damping and migration of all cuffs with 95 % intervals"
DOUBTFUL = (Standing.CHANGED, Standing.MISSING, Standing.BY_HAND)
TRUTH_FILE = "simulated_truth.json"
"""Beside the recordings of simulated devices: what the simulated cuffs carried."""
MISSING_FILE = "missing.json"
"""Beside them where the demo is not complete: a list of sentences, what is missing and why."""


class ReportError(StationError):
    """There is nothing to report; one sentence."""


def write_report(folder: Path, fitted: SessionFit | None = None, progress: Progress = silent) -> Path:
    """Writes report.html into the folder and returns its path.

    fitted spares fitting the folder's recordings again. Raises ReportError for a folder that holds nothing of ours.
    """
    if fitted is None and folder.is_dir() and pulls_in(folder):
        fitted = fit_session_folder(folder, None, progress)
    cuffs: Cuffs = fitted.cuffs if fitted else _cuffs_of(folder)
    path = folder / ASSESSMENT_FILE
    assessment = with_total_intervals(read_assessment(path)) if path.is_file() else None
    emg = read_emg_document(folder / EMG_FILE) if (folder / EMG_FILE).is_file() else None
    if not cuffs and not assessment and not emg:
        raise ReportError(Message(FolderCode.NOTHING_TO_REPORT, {"folder": str(folder)}))
    truth = _beside(folder / TRUTH_FILE, _TRUTH) or {}
    chain = chain_of(folder, is_report_included=False)
    pictures = draw_all(_planned(folder, cuffs, truth, assessment, emg), progress)
    origin = _origin(cuffs, assessment, emg)
    page = (
        _environment()
        .get_template("page.html")
        .render(
            folder=folder.resolve().name,
            facts=session_facts(folder, recordings_in(folder), fitted, origin),
            summary=summary_of(assessment, cuffs),
            cuffs=[ReportedCuff(fit, truth.get(name), pictures[f"cuff {name}"]) for name, fit in cuffs.items()],
            overview=pictures[OVERVIEW],
            has_truth=bool(truth),
            origin=origin,
            chain=chain,
            doubts=[str(link) for link in chain if link.standing in DOUBTFUL] + _contradictions(cuffs, assessment),
            inputs=json.dumps(_inputs(folder), indent=1).replace("<", "\\u003c"),
            missing=_beside(folder / MISSING_FILE, _MISSING) or (),
            trials=[trial for fit in fitted.cuffs.values() for trial in fit.trials] if fitted else [],
            rejected=fitted.rejected if fitted else (),
            assessment=assessment,
            suit=assessment_section(assessment, pictures[EFFORT], pictures[MUSCLES]) if assessment else None,
            emg=emg_section(emg, pictures[EMG]) if emg else None,
            normative=normative_section(folder, cuffs, origin),
            version=metadata.version("cuffstation"),
        )
    )
    path = folder / REPORT_FILE
    write_whole(path, page)
    write_checksums(path)
    return path


def _planned(
    folder: Path,
    cuffs: Cuffs,
    truth: Mapping[str, TrueCuff],
    assessment: Mapping[str, Any] | None,
    emg: EmgDocument | None,
) -> dict[str, Sequence[PlannedFigure]]:
    """Figures by section."""
    overview = PlannedFigure(partial(overview_figure, cuffs, truth), OVERVIEW_CAPTION, is_wide=True, is_printed=True)
    return {
        OVERVIEW: [overview] if cuffs else (),
        EFFORT: effort_figures(assessment) if assessment else (),
        MUSCLES: suit_figures(assessment, folder) if assessment else (),
        EMG: emg_figures(emg) if emg else (),
        **{f"cuff {name}": cuff_figures(fit) if isinstance(fit, CuffFit) else () for name, fit in cuffs.items()},
    }


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


def _origin(cuffs: Cuffs, assessment: Mapping[str, Any] | None, emg: EmgDocument | None) -> DataOrigin:
    """Of all that the page shows."""
    found = [fit.origin for fit in cuffs.values()]
    if assessment and assessment.get("origin") in list(DataOrigin):
        found.append(DataOrigin(assessment["origin"]))
    if emg:
        found.append(emg.origin)
    return DataOrigin.joined(found)


def _cuffs_of(folder: Path) -> dict[str, WearableCuff]:
    path = folder / "cuffs.json"
    return read_cuffs(path) if path.is_file() else {}


_TRUTH, _MISSING = TypeAdapter(dict[str, TrueCuff]), TypeAdapter(list[str])


def _beside(path: Path, kind: TypeAdapter[T]) -> T | None:
    """What stands in a file beside the recordings, None without the file."""
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


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    environment.filters |= {
        "spoken": estimate_text,
        "of_cuff": lambda text, fit, quantity: of_cuff(fit, quantity, text),
        "figure": entry_text,
        "worn": worn_text,
        "beside": true_text,
        "commands": with_commands,
    }
    return environment
