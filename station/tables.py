"""Tables of results for the terminal."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

from rich.console import Console

from documents.interval import between, bracketed, plus_minus, rounded, significant_decimals
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.published_method import PublishedFit
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.results.codes import NoteCode
from fitting.results.trial_codes import TrialNoteCode
from fitting.uncertainty import NORMAL_95, Estimate
from recordings.manifest import DataOrigin
from station.cuff_text import SHOWN, of_cuff
from station.folded_table import FoldedTable
from station.messages.assessment_messages import sources_text

if TYPE_CHECKING:
    from solver.suit.assessment import Assessment
    from solver.suit.quantity import Quantity
    from station.assessment.optimum import OptimumDocument

EFFORT_AND_ERROR = (
    "effort: of the muscles, relative to that with a slack cord; permissible error: full width of rest lengths that "
    "keep at least 90 % of the best saving"
)
Truth = Mapping[str, Mapping[str, float]]
"""Cuff → quantity → value of the simulated cuff, keys as in cuffs.json."""


def print_cuffs(fitted: SessionFit, console: Console) -> None:
    """Print a row per cuff with its last donning, then rejected recordings and notes."""
    if fitted.origin is DataOrigin.SIMULATED:
        console.print("SIMULATED data: the devices of the recordings report that they are simulated")
    console.print(cuff_table(fitted.cuffs))
    for line in _describe_calibration(fitted):
        console.print(line, highlight=False)
    for name, donnings in fitted.donnings.items():
        for donning, fit in donnings.items():
            for trial in fit.trials:
                if trial.state != "used":
                    console.print(f"{trial.file}: {trial.state}: {trial.reason}", highlight=False)
                for note in trial.notes:
                    console.print(f"{trial.file}: {note}", highlight=False)
            notes = (note for note in fit.notes if note.code is not NoteCode.NOT_CALIBRATED)
            for sentence in (*notes, *_describe_law(fit), *_describe_tensors(fit), *_describe_diagnosis(fit)):
                console.print(f"{name}, donning {donning}: {sentence}", highlight=False)
    for rejected in fitted.rejected:
        console.print(f"{rejected.file}: {rejected.reason}", highlight=False)


def _describe_calibration(fitted: SessionFit) -> Iterator[str]:
    """Source of lag and gain, for all cuffs."""
    found = fitted.calibration
    if found is None:
        fits = [fit for donnings in fitted.donnings.values() for fit in donnings.values()]
        yield from dict.fromkeys(
            str(note) for fit in fits for note in fit.notes if note.code is NoteCode.NOT_CALIBRATED
        )
        return
    lag, gain, zero = found.lag, found.gain, found.zero
    figures = f"lag {_estimate(lag, 1e3)} ms, gain {_estimate(gain)}, zero {_estimate(zero)} N"
    yield "; ".join((f"{', '.join(found.sources)}: {figures}", *map(str, found.notes)))


def cuff_table(cuffs: Mapping[str, CuffFit], truth: Truth | None = None) -> FoldedTable:
    """Value ± half width of the 95 % interval, with the Cramér-Rao bound; the truth of simulated cuffs in brackets."""
    caption = "±: half width of the 95 % interval; at best: Cramér-Rao bound"
    table = FoldedTable("cuff", *(shown.heading for shown in SHOWN.values()), "verdict", caption=caption)
    for name, fit in cuffs.items():
        true = (truth or {}).get(name, {})
        texts = (
            of_cuff(fit, quantity, _estimate(getattr(fit, quantity), shown.scale, true.get(QUANTITIES[quantity])))
            for quantity, shown in SHOWN.items()
        )
        table.add_row(name, *texts, fit.verdict)
    return table


def published_table(fits: Mapping[str, PublishedFit], fitted: SessionFit) -> FoldedTable:
    """Results of the published method, those of the fit in brackets, and the attenuation of the damping by noise."""
    caption = "in brackets: of the fit; below: k of a line through the origin; left of c: predicted, observed"
    table = FoldedTable(
        "cuff",
        "k\n[N/m]",
        "c\n[N s/m]",
        "migration\n[mm]",
        "mean\nF − k x\n[N]",
        "negative",
        "left\nof c",
        caption=caption,
    )
    for name, fit in fits.items():
        cuff = fitted.cuffs[name]
        table.add_row(
            name,
            _compare(fit.stiffness, cuff.stiffness, 1.0, ".0f")
            + ("" if fit.stiffness_through_origin is None else f"\n{fit.stiffness_through_origin:.0f}"),
            _compare(fit.damping, cuff.damping, 1.0, ".0f"),
            _compare(fit.migration, cuff.migration, 1000.0, ".2f"),
            "-" if fit.damper_force is None else f"{fit.damper_force:+.1f}",
            "-" if fit.negative_part is None else f"{100 * fit.negative_part:.0f} %",
            "-"
            if fit.predicted_attenuation is None or fit.observed_attenuation is None
            else f"{100 * fit.predicted_attenuation:.0f} %, {100 * fit.observed_attenuation:.0f} %",
        )
    return table


def assessment_table(assessment: Assessment) -> FoldedTable:
    """Normalised muscle effort of every condition at the reference rest length and at its best one."""
    reference = f"effort at {assessment.reference_rest_length:.3f} m"
    summary = assessment.uncertainty
    interval = f"; in brackets: 95 % interval, containing {sources_text(summary.sources)}" if summary else ""
    table = FoldedTable(caption=f"{EFFORT_AND_ERROR}{interval}")
    table.add_column("condition", no_wrap=True)
    for heading in ("cuff", reference, "best rest length [m]", "effort there", "permissible error [cm]"):
        table.add_column(heading)
    for curve in assessment.curves:
        figures = curve.figures
        table.add_row(
            curve.condition.replace("_", "-"),
            curve.cuff or "",
            _figure(figures["at_reference"]),
            _figure(figures["rest_length"]),
            _figure(figures["lowest_cost"]),
            _figure(figures["permissible_error"], 100.0, 1),
        )
    return table


def optimum_table(found: OptimumDocument) -> FoldedTable:
    """The given suit, the best one for the fitted cuffs, and the best on average over the drawn cuffs."""
    table = FoldedTable("suit", "rest length [m]", "stiffness [N/m]", "effort", "mean effort of draws", "95 % of draws")
    rows = {"as given": found.start, "best as fitted": found.optimum, "robust": found.robust_optimum}
    for name, suit in rows.items():
        drawn, of_draws = ["-", "-"], suit.normalised_cost_of_draws
        if of_draws is not None and of_draws.ci95 is not None:
            digits = significant_decimals(of_draws.ci95, otherwise=4)
            drawn = [rounded(of_draws.value, digits), between(of_draws.ci95, digits=4)]
        lengths = f"{suit.rest_length_m.value:.4f}", f"{suit.stiffness_n_per_m.value:.0f}"
        table.add_row(name, *lengths, f"{suit.normalised_cost.value:.4f}", *drawn)
    return table


def _describe_law(fit: CuffFit) -> Iterator[str]:
    """The law of the cuff, and the cross-validation residual of every law."""
    if fit.classes is not None:
        ranking = ", ".join(f"{score.name} {score.residual_rms:.2f} N" for score in fit.classes.ranking)
        yield f"law {fit.classes.name}; residual RMS in repeats that are left out: {ranking}"


def _describe_tensors(fit: CuffFit) -> Iterator[str]:
    """Principal values and axes of K and C, or the reason why a cuff pulled in several directions has none."""
    found = fit.tensors
    if found is None:
        return
    for name, unit, tensor in (("stiffness", "N/m", found.stiffness), ("damping", "N s/m", found.damping)):
        if tensor is not None:
            principal = (
                f"{_estimate(value)} along ({', '.join(f'{part:.2f}' for part in axis)})"
                for value, axis in zip(tensor.eigenvalues, tensor.axes, strict=True)
            )
            yield f"{name} in three dimensions [{unit}]: {'; '.join(principal)}"
    if any(note.code is TrialNoteCode.ANOTHER_LINE for trial in fit.trials for note in trial.notes):
        yield from (str(reason) for reason in (found.no_stiffness, found.no_damping) if reason)


def _describe_diagnosis(fit: CuffFit) -> Iterator[str]:
    if fit.diagnosis is not None:
        yield from (f"{finding.check}: {finding.sentence}" for finding in fit.diagnosis.findings if finding.is_alarm)
        yield from (f"likely: {cause.sentence}" for cause in fit.diagnosis.causes[:2])


def _estimate(estimate: Estimate | None, scale: float = 1.0, true: float | None = None) -> str:
    if estimate is None:
        return "not identified"
    text = plus_minus(estimate.value, estimate.ci95, scale)
    if estimate.bound is not None:
        reach = NORMAL_95 * estimate.bound
        text += f", at best ± {rounded(scale * reach, significant_decimals((-reach, reach), scale))}"
    return (
        text if true is None else f"{text} (true {rounded(scale * true, significant_decimals(estimate.ci95, scale))})"
    )


def _compare(value: float | None, estimate: Estimate | None, scale: float, form: str) -> str:
    text = "-" if value is None else f"{value * scale:{form}}"
    return text if estimate is None else f"{text} ({estimate.value * scale:{form}})"


def _figure(figure: Quantity, scale: float = 1.0, digits: int = 3) -> str:
    """As in the report: at most `digits` decimals, and the 95 % interval where they show it."""
    if figure.value is None:
        return "-"
    return bracketed(figure.value, figure.ci95, scale, digits, figure.censored, is_limited=True)
