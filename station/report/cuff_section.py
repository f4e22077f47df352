"""The report's sections on the cuffs: their fits, figures, and OpenSim elements."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

from pydantic import BaseModel

from fitting.cuffs.cuff_fit import CuffFit
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.cuffs.wearable_cuff import QUANTITIES, Cuff, bushing_force
from fitting.diagnosis.fitted_pull import FittedPull
from station.charts.marks import THIRD, Chart, Intervals, Mark, Panel, Points, chart, values
from station.report.figures import MM, dynamic_figure, static_figure, trial_figure
from station.report.fit_figures import complex_stiffness_figure, repeat_figure, repeats_figure, residual_figure
from station.report.located import LocatedObject, Source, located
from station.report.number_texts import estimate_text
from station.report.pictures import Picture, PlannedFigure
from station.report.sourced_number import Form, Rendering, SourcedNumber

Cuffs = Mapping[str, CuffFit | Cuff]

FIRST = "Force at the load cell and the cuff's displacement along the rope, without sway; shaded: fitted interval"
REPEAT = (
    "Left: held loads, the line of the pooled stiffness, and residuals. Middle: the oscillation, measured and fitted. "
    "Right: force beyond the spring over velocity, and the damper of this trial"
)
HELD = (
    "Held loads and the line of the pooled stiffness, slip between lines; with enough loads, the tangent stiffness "
    "of an exponential law over the force"
)
REPEATS = (
    "Single repeats and their combination, with 95 % intervals. The migration of the donning is from the "
    "start of its first static trial to the end of its last, that of a repeat from the start to the end of its trial"
)
DAMPER = "Force beyond the spring over velocity"
COMPLEX = "Complex stiffness K* = k + i 2πf c in bands of frequency; a spring and a damper give horizontal lines"
RESIDUAL = "Residual force of the oscillations: over time, autocorrelation, and comparison with a normal distribution"


class TrueCuff(BaseModel):
    """True parameters of a simulated cuff."""

    stiffness_n_per_m: float
    damping_n_s_per_m: float
    migration_m: float


_QUANTITIES = (
    ("stiffness", "stiffness_n_per_m", 1.0, "k [N/m]"),
    ("damping", "damping_n_s_per_m", 1.0, "c [N s/m]"),
    ("migration", "migration_m", MM, "migration [mm]"),
)
"""Of the overview: field of the fit, field of the truth, scale, axis."""


@dataclass(frozen=True)
class ReportedCuff:
    """One cuff on the page: its fit, its entry in cuffs.json, and the true cuff's in simulated_truth.json."""

    fit: CuffFit | Cuff
    entry: LocatedObject
    truth: LocatedObject | None
    pictures: Sequence[Picture]

    def figure(self, quantity: str) -> LocatedObject | None:
        """Stiffness, damping or migration with its interval and its place, identified or not."""
        return figure_of(self.fit, quantity)

    @property
    def notes(self) -> Sequence[str]:
        return self.entry.get("notes") or ()

    @property
    def tensors(self) -> list[tuple[str, str, LocatedObject]]:
        """Those that were identified, with their names and units."""
        both = (("Stiffness", "N/m", "stiffness_tensor_n_per_m"), ("Damping", "N s/m", "damping_tensor_n_s_per_m"))
        entries = [(what, unit, self.entry.get(key)) for what, unit, key in both]
        is_fit = isinstance(self.fit, CuffFit)
        return [(what, unit, tensor) for what, unit, tensor in entries if is_fit and tensor and tensor["value"]]

    @property
    def bushing(self) -> SourcedNumber | None:
        """OpenSim's element, which the fit writes to a file, too; None where a figure is missing."""
        cuff = self.fit.wearable() if isinstance(self.fit, CuffFit) else self.fit
        if cuff.missing:
            return None
        return SourcedNumber(bushing_force(cuff), self.entry.source, Rendering(Form.BUSHING))


def figure_of(fit: CuffFit | Cuff, quantity: str) -> LocatedObject | None:
    """Stiffness, damping or migration with its interval and its place in cuffs.json, identified or not."""
    estimate, source = getattr(fit, quantity), Source(CUFFS_FILE, "/cuffs").child(fit.name)
    if estimate is None:
        return None
    if quantity in fit.missing:
        source = source.child("not_identified")
    number = {"value": estimate.value, "ci95": list(estimate.ci95)}
    found: LocatedObject = located(number, source.child(QUANTITIES[quantity]))
    return found


def overview_figure(cuffs: Cuffs, truth: Mapping[str, TrueCuff]) -> Chart:
    """Forest plot: k, c and migration of all cuffs with 95 % intervals, and the true values of simulated ones."""
    return chart(*(_overview_panel(cuffs, truth, *quantity) for quantity in _QUANTITIES), has_one_legend=True)


def cuff_figures(fit: CuffFit) -> list[PlannedFigure]:
    """Of one cuff: its repeats together, then every repeat, then checks of the law. Only the first two are printed."""
    found = [fit.pulls[file] for file in fit.sources if file in fit.pulls]
    static = [curves for curves in found if curves.pull.trial.test == "static"]
    dynamic = [curves for curves in found if curves.pull.trial.test == "dynamic"]
    figures = []
    if static or dynamic:
        figures.append(PlannedFigure(partial(repeats_figure, fit), REPEATS, is_wide=True, is_printed=True))
    if static:
        figures.append(PlannedFigure(partial(static_figure, fit, static), HELD, is_wide=True, is_printed=True))
    if static or dynamic:
        first = partial(trial_figure, static[0] if static else None, dynamic[0] if dynamic else None)
        figures.append(PlannedFigure(first, FIRST, is_wide=True))
    figures += _repeats(fit, static, dynamic)
    if any(curves.dynamic for curves in dynamic):
        figures.append(PlannedFigure(partial(dynamic_figure, fit, dynamic), DAMPER))
        if fit.complex_stiffness:
            figures.append(PlannedFigure(partial(complex_stiffness_figure, fit), COMPLEX, is_wide=True))
        figures.append(PlannedFigure(partial(residual_figure, dynamic), RESIDUAL, is_wide=True))
    return figures


def _repeats(fit: CuffFit, static: Sequence[FittedPull], dynamic: Sequence[FittedPull]) -> Iterator[PlannedFigure]:
    """A figure of every repeat of which anything was used."""
    held = {curves.pull.trial.repeat: curves for curves in static}
    swung = {curves.pull.trial.repeat: curves for curves in dynamic}
    for repeat in sorted({*held, *swung}):
        plan = partial(repeat_figure, fit, held.get(repeat), swung.get(repeat))
        yield PlannedFigure(plan, f"Repeat {repeat}. {REPEAT}", is_wide=True)


def _overview_panel(
    cuffs: Cuffs, truth: Mapping[str, TrueCuff], name: str, true_name: str, scale: float, axis: str
) -> Panel:
    found = [(place, cuff, getattr(fit, name)) for place, (cuff, fit) in enumerate(cuffs.items())]
    known = [(place, cuff, estimate) for place, cuff, estimate in found if estimate is not None]
    places = values([place for place, _, _ in known])
    ends = scale * values([estimate.ci95 for *_, estimate in known]).reshape(-1, 2)
    titles = tuple(f"{cuff}: {estimate_text(estimate, scale)}" for _, cuff, estimate in known)
    marks: list[Mark] = [Intervals(places, ends[:, 0], ends[:, 1], "c1", is_upright=False)]
    if truth:
        true = [(place, getattr(truth[cuff], true_name)) for place, cuff, _ in found if cuff in truth]
        true_places, true_values = values([place for place, _ in true]), scale * values([value for _, value in true])
        marks.append(Points(true_values, true_places, "c2", "true value", is_hollow=True))
    marks.append(
        Points(scale * values([estimate.value for *_, estimate in known]), places, "c1", "fitted", titles=titles)
    )
    return Panel(
        tuple(marks),
        axis,
        y_names=tuple(cuffs),
        x_limits=(0.0, None),
        width=THIRD,
        height=55.0 + 22.0 * len(cuffs),
    )
