"""One self-contained page of all that a folder holds: recordings, fitted cuffs, assessment, and the hashes of them."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from fitting.curves import TrialCurves
from fitting.result import CuffFit, SessionFit, read_cuffs
from fitting.uncertainty import Estimate
from station.assessment_section import assessment_section
from station.figures import dynamic_figure, static_figure, trial_figure
from station.fit import fit_session_folder, recordings_in
from station.pictures import Picture, picture
from station.progress import Progress, silent
from station.whole_file import write_whole

TRUTH_FILE = "simulated_truth.json"
"""Beside the recordings of simulated devices: what the simulated cuffs carried."""


class ReportError(Exception):
    """There is nothing to report; one sentence."""


@dataclass(frozen=True)
class CuffSection:
    """One cuff on the page."""

    fit: CuffFit
    truth: Mapping[str, float]
    pictures: tuple[Picture, ...]


def write_report(folder: Path, fitted: SessionFit | None = None, progress: Progress = silent) -> Path:
    """Writes report.html into the folder and returns its path.

    fitted spares fitting the folder's recordings again. Raises ReportError for a folder that holds nothing of ours.
    """
    if fitted is None and folder.is_dir() and recordings_in(folder):
        fitted = fit_session_folder(folder, None, progress)
    cuffs = fitted.cuffs if fitted else _cuffs_of(folder)
    assessment = _json_of(folder / "assessment.json")
    if not cuffs and not assessment:
        raise ReportError(f"{folder} holds no recording, no cuffs.json and no assessment.json to report")
    truth = _json_of(folder / TRUTH_FILE) or {}
    page = (
        _environment()
        .get_template("report.html")
        .render(
            folder=folder.resolve().name,
            cuffs=_cuff_sections(cuffs, fitted, truth, progress),
            has_truth=bool(truth),
            trials=[trial for fit in cuffs.values() for trial in fit.trials],
            rejected=fitted.rejected if fitted else (),
            assessment=assessment,
            suit=assessment_section(assessment, folder) if assessment else None,
            version=metadata.version("cuffstation"),
        )
    )
    path = folder / "report.html"
    write_whole(path, page)
    return path


def _cuffs_of(folder: Path) -> dict[str, CuffFit]:
    path = folder / "cuffs.json"
    return read_cuffs(path) if path.is_file() else {}


def _json_of(path: Path) -> dict[str, Any] | None:
    if not path.is_file():
        return None
    try:
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    except ValueError as error:
        raise ReportError(f"{path} is not valid JSON: {error}; make it again") from error
    return content


def _cuff_sections(
    cuffs: Mapping[str, CuffFit], fitted: SessionFit | None, truth: Mapping[str, Any], progress: Progress
) -> list[CuffSection]:
    sections = []
    for done, (name, fit) in enumerate(cuffs.items()):
        progress("drawing cuffs", done, len(cuffs))
        curves = [fitted.curves[file] for file in fit.sources if file in fitted.curves] if fitted else []
        sections.append(CuffSection(fit, truth.get(name, {}), _pictures_of(fit, curves)))
    progress("drawing cuffs", len(cuffs), len(cuffs))
    return sections


def _pictures_of(fit: CuffFit, curves: list[TrialCurves]) -> tuple[Picture, ...]:
    static = [each for each in curves if each.trial.test == "static"]
    dynamic = [each for each in curves if each.trial.test == "dynamic"]
    pictures = []
    if static or dynamic:
        png = trial_figure(static[0] if static else None, dynamic[0] if dynamic else None)
        caption = (
            "Force at the load cell and the cuff's displacement along the rope, sway removed; shaded: what is fitted"
        )
        pictures.append(picture(png, caption))
    if static:
        pictures.append(
            picture(static_figure(fit, static), "Held loads and the line of the common stiffness; slip between lines")
        )
    if dynamic:
        pictures.append(picture(dynamic_figure(fit, dynamic), "What the spring does not explain, over velocity"))
    return tuple(pictures)


def _environment() -> Environment:
    environment = Environment(loader=PackageLoader("station", "pages"), autoescape=True, undefined=StrictUndefined)
    environment.filters["spoken"] = _spoken
    environment.filters["figure"] = _figure
    return environment


def _spoken(estimate: Estimate | None, scale: float = 1.0, digits: int = 0) -> str:
    """Value and 95 % interval in words."""
    if estimate is None:
        return "not identified"
    low, high = estimate.ci95
    return f"{estimate.value * scale:.{digits}f} ({low * scale:.{digits}f} to {high * scale:.{digits}f})"


def _figure(number: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    if not number or number["value"] is None:
        return "–"
    words = f"{number['value'] * scale:.{digits}f}"
    if number.get("ci95"):
        low, high = number["ci95"]
        words += f" ({low * scale:.{digits}f} to {high * scale:.{digits}f})"
    return words
