"""One self-contained page of all that a folder holds: recordings, fitted cuffs, assessment, and the hashes of them."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import Any, TypeVar

from jinja2 import Environment, FileSystemLoader, StrictUndefined
from pydantic import BaseModel, TypeAdapter, ValidationError

from documents.plain_data import PlainDataError, read_json
from documents.validation import describe_error
from fitting.bushing import bushing_force
from fitting.cuffs_file import read_cuffs
from fitting.curves import TrialCurves
from fitting.result import CuffFit, SessionFit
from fitting.seal import Standing
from fitting.spatial.tensor import Tensor
from fitting.uncertainty import Estimate
from fitting.wearable_cuff import QUANTITIES, UNITS, WearableCuff
from recordings.manifest import DataOrigin
from station.assessment.assessment_file import read_assessment
from station.assessment.assessment_json import ACTIVATIONS_FILE, ASSESSMENT_FILE
from station.checksums import sha256_of, write_checksums
from station.errors import StationError
from station.files.chain import CUFFS_FILE, REPORT_FILE, chain_of
from station.fit import fit_session_folder, recordings_in
from station.interval import bracketed, digits_of, of_cuff, rounded
from station.progress import Progress, silent
from station.report.assessment_section import assessment_section, suit_figures
from station.report.figures import dynamic_figure, static_figure, trial_figure
from station.report.fit_figures import complex_stiffness_figure, repeat_figure, repeats_figure, residual_figure
from station.report.pictures import Picture, PlannedFigure, draw_all
from station.whole_file import write_whole

T = TypeVar("T")

DOUBTFUL = (Standing.CHANGED, Standing.MISSING, Standing.BY_HAND)
FIRST = "Force at the load cell and the cuff's displacement along the rope, sway removed; shaded: what is fitted"
REPEAT = (
    "Left: held loads, the line of the common stiffness, and how far they lie off it. Middle: the swing as measured "
    "and as fitted. Right: what the spring does not explain, over velocity, and this trial's damper"
)
HELD = (
    "Held loads and the line of the common stiffness, slip between lines; where there are loads enough, the tangent "
    "stiffness of an exponential law over the force"
)
REPEATS = "Each repeat on its own and what they say together, with 95 % intervals"
DAMPER = "What the spring does not explain, over velocity"
COMPLEX = "Complex stiffness K* = k + i 2πf c in bands of frequency: level lines are what a spring and a damper have"
LEFT_OVER = (
    "What the law leaves of the force of the swings: over time, against itself later, against a normal distribution"
)
TRUTH_FILE = "simulated_truth.json"
"""Beside the recordings of simulated devices: what the simulated cuffs carried."""
MISSING_FILE = "missing.json"
"""Beside them where the demo is not complete: a list of sentences, what is missing and why."""


_Cuffs = Mapping[str, CuffFit | WearableCuff]


class ReportError(StationError):
    """There is nothing to report; one sentence."""


@dataclass(frozen=True)
class ReportedCuff:
    """One cuff on the page."""

    fit: CuffFit | WearableCuff
    truth: _Truth | None
    pictures: tuple[Picture, ...]

    @property
    def tensors(self) -> list[tuple[str, str, Tensor]]:
        """Those that are told, with their names and units."""
        found = self.fit.tensors if isinstance(self.fit, CuffFit) else None
        both = (("Stiffness", "N/m", found and found.stiffness), ("Damping", "N s/m", found and found.damping))
        return [(what, unit, tensor) for what, unit, tensor in both if tensor]

    @property
    def bushing(self) -> str:
        """OpenSim's element, empty where a figure is missing."""
        return "" if self.fit.missing else bushing_force(self.fit)


def write_report(folder: Path, fitted: SessionFit | None = None, progress: Progress = silent) -> Path:
    """Writes report.html into the folder and returns its path.

    fitted spares fitting the folder's recordings again. Raises ReportError for a folder that holds nothing of ours.
    """
    if fitted is None and folder.is_dir() and recordings_in(folder):
        fitted = fit_session_folder(folder, None, progress)
    cuffs: _Cuffs = fitted.cuffs if fitted else _cuffs_of(folder)
    assessment = read_assessment(folder / ASSESSMENT_FILE) if (folder / ASSESSMENT_FILE).is_file() else None
    if not cuffs and not assessment:
        raise ReportError(f"{folder} holds no recording, no cuffs.json and no assessment.json to report")
    truth = _beside(folder / TRUTH_FILE, _TRUTH) or {}
    chain = chain_of(folder, is_report_included=False)
    curves = fitted.curves if fitted else {}
    planned: dict[str | None, Sequence[PlannedFigure]] = {
        None: suit_figures(assessment, folder) if assessment else (),
        **{name: _figures_of(fit, curves) if isinstance(fit, CuffFit) else () for name, fit in cuffs.items()},
    }
    pictures = draw_all(planned, progress)
    page = (
        _environment()
        .get_template("page.html")
        .render(
            folder=folder.resolve().name,
            cuffs=[ReportedCuff(fit, truth.get(name), pictures[name]) for name, fit in cuffs.items()],
            has_truth=bool(truth),
            origin=_origin(cuffs, assessment),
            chain=chain,
            doubts=[str(link) for link in chain if link.standing in DOUBTFUL] + _contradictions(cuffs, assessment),
            inputs=json.dumps(_inputs(folder), indent=1).replace("<", "\\u003c"),
            missing=_beside(folder / MISSING_FILE, _MISSING) or (),
            trials=[trial for fit in fitted.cuffs.values() for trial in fit.trials] if fitted else [],
            rejected=fitted.rejected if fitted else (),
            assessment=assessment,
            suit=assessment_section(assessment, pictures[None]) if assessment else None,
            version=metadata.version("cuffstation"),
        )
    )
    path = folder / REPORT_FILE
    write_whole(path, page)
    write_checksums(path)
    return path


def _inputs(folder: Path) -> dict[str, str]:
    """File → SHA-256 of all that the page is made of."""
    made_of = [*recordings_in(folder), *(folder / name for name in (CUFFS_FILE, ASSESSMENT_FILE, ACTIVATIONS_FILE))]
    return {path.name: sha256_of(path) for path in made_of if path.is_file()}


def _contradictions(cuffs: _Cuffs, assessment: Mapping[str, Any] | None) -> list[str]:
    """Where the assessment wears other figures than those in the table of cuffs, in sentences."""
    said = []
    for name, worn in ((assessment or {}).get("cuffs") or {}).items():
        for quantity, key in QUANTITIES.items() if name in cuffs else ():
            shown, entry = getattr(cuffs[name], quantity), worn.get(key) or {}
            value = entry.get("value")
            if shown is None or value is None or math.isclose(shown.value, value, rel_tol=1e-9):
                continue
            by_hand = f", {Standing.BY_HAND}" if entry.get("source") == Standing.BY_HAND else ""
            said.append(
                f"the muscles below were solved with another {quantity} of cuff {name} than the one in the table: "
                f"{value:.6g} {UNITS[quantity]}{by_hand}, and the table has {shown.value:.6g}"
            )
    return said


def _origin(cuffs: _Cuffs, assessment: Mapping[str, Any] | None) -> DataOrigin:
    """Of all that the page shows."""
    found = [fit.origin for fit in cuffs.values()]
    if assessment and assessment.get("origin") in list(DataOrigin):
        found.append(DataOrigin(assessment["origin"]))
    return DataOrigin.joined(found)


def _cuffs_of(folder: Path) -> dict[str, WearableCuff]:
    path = folder / "cuffs.json"
    return read_cuffs(path) if path.is_file() else {}


class _Truth(BaseModel):
    stiffness_n_per_m: float
    damping_n_s_per_m: float
    migration_m: float


_TRUTH, _MISSING = TypeAdapter(dict[str, _Truth]), TypeAdapter(list[str])


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


def _figures_of(fit: CuffFit, curves: Mapping[str, TrialCurves]) -> list[PlannedFigure]:
    found = [curves[file] for file in fit.sources if file in curves]
    static = [each for each in found if each.trial.test == "static"]
    dynamic = [each for each in found if each.trial.test == "dynamic"]
    figures = []
    if static or dynamic:
        first = partial(trial_figure, static[0] if static else None, dynamic[0] if dynamic else None)
        figures += [
            PlannedFigure(first, FIRST, is_wide=True),
            PlannedFigure(partial(repeats_figure, fit), REPEATS, is_wide=True),
        ]
    figures += _repeats(fit, static, dynamic)
    if static:
        figures.append(PlannedFigure(partial(static_figure, fit, static), HELD, is_wide="exponential_law" in fit.held))
    if any(each.dynamic for each in dynamic):
        figures.append(PlannedFigure(partial(dynamic_figure, fit, dynamic), DAMPER))
        if fit.complex_stiffness:
            figures.append(PlannedFigure(partial(complex_stiffness_figure, fit), COMPLEX, is_wide=True))
        figures.append(PlannedFigure(partial(residual_figure, dynamic), LEFT_OVER, is_wide=True))
    return figures


def _repeats(fit: CuffFit, static: list[TrialCurves], dynamic: list[TrialCurves]) -> list[PlannedFigure]:
    """A figure of every repeat of which anything was used."""
    held = {each.trial.repeat: each for each in static}
    swung = {each.trial.repeat: each for each in dynamic}
    return [
        PlannedFigure(
            partial(repeat_figure, fit, held.get(repeat), swung.get(repeat)), f"Repeat {repeat}. {REPEAT}", is_wide=True
        )
        for repeat in sorted({*held, *swung})
    ]


def _environment() -> Environment:
    environment = Environment(
        loader=FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=StrictUndefined
    )
    environment.filters["spoken"] = _spoken
    environment.filters["of_cuff"] = lambda words, fit, quantity: of_cuff(fit, quantity, words)
    environment.filters["figure"] = _figure
    environment.filters["worn"] = _worn
    environment.filters["beside"] = _beside_estimate
    return environment


def _worn(number: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    """A figure that the assessment wears, with its source where that is not the fit."""
    by_hand = number is not None and number.get("source") == Standing.BY_HAND
    return f"{_figure(number, scale, digits)}{' (given by hand)' if by_hand else ''}"


def _spoken(estimate: Estimate | None, scale: float = 1.0) -> str:
    """Value and 95 % interval in words."""
    return "not identified" if estimate is None else bracketed(estimate.value, estimate.ci95, scale)


def _beside_estimate(true: float, estimate: Estimate | None, scale: float = 1.0) -> str:
    """What is known exactly, with as many digits as the estimate above it."""
    return rounded(scale * true, digits_of(estimate.ci95 if estimate else None, scale))


def _figure(number: Mapping[str, Any] | None, scale: float = 1.0, digits: int = 3) -> str:
    if not number or number["value"] is None:
        return "–"
    return bracketed(number["value"], number.get("ci95"), scale, digits)
