"""Results as tables for a terminal; the JSON beside them is for programs."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from rich.console import Console
from rich.table import Table

from fitting.published_method import PublishedFit
from fitting.result import CuffFit, SessionFit
from fitting.spatial.directions import ELSEWHERE
from fitting.uncertainty import NORMAL_95, Estimate
from recordings.manifest import DataOrigin
from solver.suit.assessment import Assessment, Quantity
from solver.suit.optimise import OptimisedSuit
from station.interval import between, digits_of, of_cuff, plus_minus, rounded

Truth = Mapping[str, Mapping[str, float]]
"""Cuff → quantity → what the simulated cuff carries, keys as in cuffs.json."""


def print_cuffs(fitted: SessionFit, console: Console) -> None:
    """One row per cuff as last donned, then what could not be used and what should be known."""
    if fitted.origin is DataOrigin.SIMULATED:
        console.print("SIMULATED data: the devices of the recordings said that they are simulated")
    console.print(cuff_table(fitted.cuffs))
    console.print(_calibrated(fitted), highlight=False)
    for name, donnings in fitted.donnings.items():
        for donning, fit in donnings.items():
            for trial in fit.trials:
                if trial.state != "used":
                    console.print(f"{trial.file}: {trial.state}: {trial.reason}", highlight=False)
                for note in trial.notes:
                    console.print(f"{trial.file}: {note}", highlight=False)
            for sentence in (*fit.notes, *_law(fit), *_in_space(fit), *_diagnosed(fit)):
                console.print(f"{name}, donning {donning}: {sentence}", highlight=False)
    for rejected in fitted.rejected:
        console.print(f"{rejected.file}: {rejected.reason}", highlight=False)


def _calibrated(fitted: SessionFit) -> str:
    """Where the lag between force and markers comes from."""
    found = fitted.calibration
    if found is None:
        return "lag and gain of the load cell are as declared; calibrate them with `station record --test bounce`"
    lag, gain, zero = found.lag, found.gain, found.zero
    words = f"{', '.join(found.sources)}: lag {_spoken(lag, 1e3)} ms, gain {_spoken(gain)}, zero {_spoken(zero)} N"
    return "; ".join((words, *found.notes))


def cuff_table(cuffs: Mapping[str, CuffFit], truth: Truth | None = None) -> Table:
    """Value ± half-width of the 95 % interval, and what the Cramér-Rao bound allows at best.

    With the truth of simulated cuffs, that in brackets.
    """
    caption = "± is half of the 95 % interval; at best: what the Cramér-Rao bound allows"
    table = Table("cuff", "k [N/m]", "c [N s/m]", "migration [mm]", "verdict", caption=caption)
    for name, fit in cuffs.items():
        true = (truth or {}).get(name, {})
        table.add_row(
            name,
            of_cuff(fit, "stiffness", _spoken(fit.stiffness, true=true.get("stiffness_n_per_m"))),
            of_cuff(fit, "damping", _spoken(fit.damping, true=true.get("damping_n_s_per_m"))),
            of_cuff(fit, "migration", _spoken(fit.migration, 1000.0, true=true.get("migration_m"))),
            fit.verdict,
        )
    return table


def published_table(fits: Mapping[str, PublishedFit], fitted: SessionFit) -> Table:
    """The published method's figures, with those of the fit in brackets, and what noise leaves of the damping."""
    table = Table("cuff", "k [N/m]", "c [N s/m]", "migration [mm]", "mean F − k x [N]", "negative", "left of c")
    for name, fit in fits.items():
        cuff = fitted.cuffs[name]
        table.add_row(
            name,
            _beside(fit.stiffness, cuff.stiffness, 1.0, ".0f"),
            _beside(fit.damping, cuff.damping, 1.0, ".0f"),
            _beside(fit.migration, cuff.migration, 1000.0, ".2f"),
            "-" if fit.damper_force is None else f"{fit.damper_force:+.1f}",
            "-" if fit.negative_part is None else f"{100 * fit.negative_part:.0f} %",
            "-"
            if fit.predicted_left is None or fit.observed_left is None
            else f"predicted {100 * fit.predicted_left:.0f} %, observed {100 * fit.observed_left:.0f} %",
        )
    return table


def assessment_table(assessment: Assessment) -> Table:
    """Normalised muscle cost of every condition at the reference rest length and at its own best one."""
    reference = f"cost at {assessment.reference_rest_length:.2f} m"
    table = Table()
    table.add_column("condition", no_wrap=True)
    for heading in ("arm cuff", reference, "best rest length [m]", "cost there", "90 % width [cm]"):
        table.add_column(heading)
    for curve in assessment.curves:
        table.add_row(
            curve.condition.replace("_", "-"),
            curve.cuff or "",
            _figure(curve.figures["at_reference"]),
            _figure(curve.figures["rest_length"]),
            _figure(curve.figures["lowest_cost"]),
            _figure(curve.figures["permissible_error"], 100.0, 2),
        )
    return table


def optimum_table(optimised: OptimisedSuit) -> Table:
    """The suit as it was, the best with the fitted cuffs, and the best on average over the drawn ones."""
    table = Table("suit", "rest length [m]", "stiffness [N/m]", "cost", "mean cost of draws", "95 % of draws")
    rows = {"as given": optimised.start, "best as fitted": optimised.fitted, "robust": optimised.robust}
    for name, tried in rows.items():
        drawn = ["-", "-"]
        if tried.drawn.size:
            low, high = np.quantile(tried.drawn, [0.025, 0.975])
            digits = digits_of((low, high), otherwise=4)
            drawn = [rounded(float(tried.drawn.mean()), digits), between((low, high), digits=4)]
        lengths = f"{tried.suit.reference_rest_length:.4f}", f"{tried.suit.stiffness:.0f}"
        table.add_row(name, *lengths, f"{tried.cost:.4f}", *drawn)
    return table


def _law(fit: CuffFit) -> Iterator[str]:
    """The law that describes the cuff, and the others by the force they leave over in repeats left out."""
    if fit.classes is not None:
        ranking = ", ".join(f"{score.name} {score.residual_rms:.2f} N" for score in fit.classes.ranking)
        yield f"its law is {fit.classes.name}; left over in repeats left out: {ranking}"


def _in_space(fit: CuffFit) -> Iterator[str]:
    """Principal values and axes of K and C, or why there are none for a cuff that was pulled in several directions."""
    found = fit.tensors
    if found is None:
        return
    for name, unit, tensor in (("stiffness", "N/m", found.stiffness), ("damping", "N s/m", found.damping)):
        if tensor is not None:
            each = (
                f"{_spoken(value)} along ({', '.join(f'{part:.2f}' for part in axis)})"
                for value, axis in zip(tensor.eigenvalues, tensor.axes, strict=True)
            )
            yield f"{name} in three dimensions [{unit}]: {'; '.join(each)}"
    if any(ELSEWHERE in note for trial in fit.trials for note in trial.notes):
        yield from (reason for reason in (found.no_stiffness, found.no_damping) if reason)


def _diagnosed(fit: CuffFit) -> Iterator[str]:
    if fit.diagnosis is not None:
        yield from (f"{each.check}: {each.sentence}" for each in fit.diagnosis.findings if each.is_alarm)
        yield from (f"likely: {cause.sentence}" for cause in fit.diagnosis.causes[:2])


def _spoken(estimate: Estimate | None, scale: float = 1.0, true: float | None = None) -> str:
    if estimate is None:
        return "not identified"
    words = plus_minus(estimate.value, estimate.ci95, scale)
    if estimate.bound is not None:
        reach = NORMAL_95 * estimate.bound
        words += f", at best ± {rounded(scale * reach, digits_of((-reach, reach), scale))}"
    return words if true is None else f"{words} (true {rounded(scale * true, digits_of(estimate.ci95, scale))})"


def _beside(value: float | None, estimate: Estimate | None, scale: float, form: str) -> str:
    words = "-" if value is None else f"{value * scale:{form}}"
    return words if estimate is None else f"{words} ({estimate.value * scale:{form}})"


def _figure(figure: Quantity, scale: float = 1.0, digits: int = 4) -> str:
    """Value ± half-width of the 95 % interval, where there is one."""
    return "-" if figure.value is None else plus_minus(figure.value, figure.ci95, scale, digits)
