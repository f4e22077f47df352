"""Muscle effort saved by a suit in a motion, with rigid cuffs and with the fitted ones.

Cost is the sum of w a² over muscles and frames, relative to that of the suit with a slack cord.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from documents.interval import bracketed, counted
from documents.message import Code, Message
from documents.results import EqualByFields, curves_svg, labelled_dataset, result_html
from solver.cuff import CuffParameters, by_site
from solver.errors import SolverCode, describe_codes
from solver.muscle import MuscleOutcome
from solver.redundancy.motion_solution import LoadedMotion
from solver.redundancy.problem import FrameOutcome
from solver.suit.cord import CUFF_CONDITIONS, Condition, SuitScenario
from solver.suit.decision import Basis, CuffDecision, DecisionRule
from solver.suit.quantity import Quantity
from solver.suit.scenarios import (
    FIGURES,
    CurveReadouts,
    Place,
    ScenarioEffort,
    SuitedMotion,
    prepare_suited_motion,
    read_off_curves,
    solve_scenarios,
    solve_without_suit,
)
from solver.suit.suit import Suit, SuitError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True, eq=False)
class EffortCurve(EqualByFields):
    """One condition over the rest lengths, and its results.

    cuff          the arm cuff's name, None in the rigid condition
    cost          (rest lengths,) normalised cost of the muscles;  reserve_cost (rest lengths,) of the reserves
    cost_ci95     (rest lengths, 2) ends of the 95 % interval of cost, NaN where it is unknown; None without people
    activations   (frames, muscles) at the reference rest length
    unsolved      (frame, rest length) pairs that are not SOLVED
    figures       name of a field of CurveReadouts → its figure, with the unit given there
    reduction     muscle or group of muscles → its figure of CurveReadouts.reduction
    """

    condition: Condition
    cuff: str | None
    cost: Array
    reserve_cost: Array
    activations: Array
    unsolved: int
    figures: Mapping[str, Quantity]
    reduction: Mapping[str, Quantity]
    cost_ci95: Array | None = None

    def __repr__(self) -> str:
        known = {name: figure.value for name, figure in self.figures.items() if figure.value is not None}
        figures = ", ".join(f"{name} {value:.4g}" for name, value in known.items())
        named = " ".join(filter(None, (self.condition, self.cuff)))
        return f"EffortCurve {named}: {len(self.cost)} rest lengths; {figures}"


@dataclass(frozen=True)
class Comparison:
    """Two arm cuffs, both shifted and yielding: cost of the first less that of the second at the reference length."""

    cuffs: tuple[str, str]
    cost_difference: Quantity

    @property
    def differ(self) -> bool | None:
        """Whether the interval excludes zero; None without an interval."""
        interval = self.cost_difference.ci95
        return None if interval is None else not interval[0] <= 0 <= interval[1]


@dataclass(frozen=True, eq=False)
class UncertaintySummary(EqualByFields):
    """Sources of the intervals of an assessment, and the decision between the arm cuffs.

    people    drawn;  solved: with an effort at the reference rest length of every curve;  every: N-th frame
    unsolved  outcome of the people who are not solved → number, the most frequent first;  infeasible: number of people
              whose muscles cannot do the motion, who are left out
    sources   groups of sources that were drawn
    content   bounds (95 %) of the part of all people that an interval from so many contains
    largest_difference  name of a field of CurveReadouts → largest |decimated − whole| over all conditions, or NaN
    decisions between the cuffs that yield and have migrated;  rule: as decided
    """

    people: int
    solved: int
    every: int
    unsolved: Mapping[str, int]
    sources: tuple[str, ...]
    content: tuple[float, float]
    largest_difference: Mapping[str, float]
    decisions: Mapping[Basis, CuffDecision]
    rule: DecisionRule
    infeasible: int = 0

    @property
    def is_total(self) -> bool:
        """Whether more than the noise of the cuffs' fit was drawn."""
        return set(self.sources) != {"fit"}


TABLE = {
    "effort_at_reference": "at_reference",
    "least_effort": "lowest_cost",
    "rest_length_m": "rest_length",
    "permissible_error_m": "permissible_error",
}
"""Column of Assessment.to_dataframe → field of CurveReadouts."""


@dataclass(frozen=True, eq=False, repr=False)
class Assessment(EqualByFields):
    """Effort saved by the suit in one motion; costs are relative to the suit with a slack cord, which is 1.

    muscles         names, in the order of all such axes;  time (frames,) [s] of the activations
    rest_lengths    (rest lengths,) tried [m];  reference_rest_length [m]
    bare_body_cost  without the suit's masses
    longest_cord    greatest length of the cord's line [m]; at a greater rest length the cord is always slack
    waist_cuff      name of the cuff that yields at the waist, None for a rigid one
    slack           (frames, muscles) activations with a slack cord
    curves          rigid first, then each arm cuff in each condition
    uncertainty     where the intervals are from, None without drawn people; see solver.uncertainty.total
    scenarios       number of scenarios that were solved
    outcomes        each FrameOutcome but SOLVED that occurs → (frame, scenario) pairs that ended so
    muscle_outcomes each MuscleOutcome but CONVERGED that occurs → frames in which a muscle ended so
    has_glenoid_cone  whether the joint reaction was kept inside a glenoid
    findings        of cuffstation.assess: on the cuffs, their intervals, frames without a solution, motion and loads
    """

    muscles: tuple[str, ...]
    time: Array
    rest_lengths: Array
    reference_rest_length: float
    bare_body_cost: float
    longest_cord: float
    waist_cuff: str | None
    slack: Array
    curves: tuple[EffortCurve, ...]
    comparisons: tuple[Comparison, ...]
    uncertainty: UncertaintySummary | None
    scenarios: int
    outcomes: Mapping[FrameOutcome, int]
    muscle_outcomes: Mapping[MuscleOutcome, int]
    has_glenoid_cone: bool = True
    findings: tuple[Message[Code], ...] = ()

    def __repr__(self) -> str:
        columns = ["condition", "cuff", *TABLE]
        rows = self.to_dataframe()[columns].to_string(index=False, float_format="{:.4g}".format)
        title = (
            f"Assessment: {self.scenarios} scenarios, {counted(self.unsolved, 'frame')} not solved; "
            "effort over a slack cord"
        )
        return f"{title}{describe_codes(self.findings)}\n{rows}"

    def to_dataframe(self) -> pd.DataFrame:
        """A row per curve: condition, cuff, and the four figures of TABLE with the ends of their 95 % intervals.

        least_effort and rest_length_m are those of the curve between the lengths tried (find_minimum), as in the
        report; NaN where the best length tried is the first or the last, or for a missing interval.
        """
        import pandas as pd

        rows = [{"condition": curve.condition, "cuff": curve.cuff or "", **_row(curve)} for curve in self.curves]
        table = pd.DataFrame(rows)
        table.attrs["units"] = {column: "m" for column in table if "_m" in str(column)}
        return table

    def effort_curves(self) -> pd.DataFrame:
        """A row per condition, cuff and rest length: effort of the muscles and of the reserves over a slack cord."""
        import pandas as pd

        tables = [
            pd.DataFrame(
                {
                    "condition": curve.condition,
                    "cuff": curve.cuff or "",
                    "rest_length_m": self.rest_lengths,
                    "effort": curve.cost,
                    "reserve_effort": curve.reserve_cost,
                }
            )
            for curve in self.curves
        ]
        table = pd.concat(tables, ignore_index=True)
        table.attrs["units"] = {"rest_length_m": "m"}
        return table

    def activations(self, condition: Condition | Literal["slack"], cuff: str | None = None) -> pd.DataFrame:
        """A row per frame: time_s and an activation per muscle at the reference rest length, or with a slack cord.

        cuff: the arm cuff, where there are several. assess(reference_rest_length=…) gives those at another length.
        Raises ValueError for a condition or a cuff that was not assessed.
        """
        import pandas as pd

        found = {curve.cuff: curve.activations for curve in self.curves if curve.condition == condition}
        found = {None: self.slack} if condition == "slack" else found
        if cuff in found or (len(found) == 1 and cuff is None):
            values = found[cuff] if cuff in found else next(iter(found.values()))
            table = pd.DataFrame(values, columns=list(self.muscles))
            table.insert(0, "time_s", self.time)
            table.attrs["units"] = {"time_s": "s"}
            return table
        known = ", ".join(["slack", *(f"{curve.condition} {curve.cuff or ''}".strip() for curve in self.curves)])
        raise ValueError(f"condition and cuff are {condition!r} and {cuff!r}, expected one of: {known}")

    def to_xarray(self) -> xr.Dataset:
        """effort (curve, rest_length) and activations (curve, time, muscle), with condition and cuff of each curve.

        Needs the extra xarray.
        """
        variables = {
            "effort": (("curve", "rest_length"), np.array([curve.cost for curve in self.curves]), ""),
            "activations": (("curve", "time", "muscle"), np.array([curve.activations for curve in self.curves]), ""),
            "condition": (("curve",), [curve.condition for curve in self.curves], ""),
            "cuff": (("curve",), [curve.cuff or "" for curve in self.curves], ""),
        }
        axes = {"rest_length": (self.rest_lengths, "m"), "time": (self.time, "s"), "muscle": (self.muscles, "")}
        return labelled_dataset(variables, axes)

    def _repr_html_(self) -> str:
        rows = [
            (curve.condition, curve.cuff or "", *(_text(curve.figures[field], field) for field in TABLE.values()))
            for curve in self.curves
        ]
        of_curve = ("effort at reference", "least effort", "at rest length [mm]", "permissible error [mm]")
        drawing = curves_svg([(self.rest_lengths, curve.cost) for curve in self.curves], "m", "effort")
        return result_html("Assessment", ("condition", "cuff", *of_curve), rows, repr(self).partition("\n")[0], drawing)

    @property
    def unsolved(self) -> int:
        """(frame, scenario) pairs that are not SOLVED."""
        return sum(self.outcomes.values())


def assess(
    motion: LoadedMotion,
    suit: Suit,
    cuffs: Iterable[CuffParameters],
    *,
    every: int = 1,
    progress: Progress = lambda *_: None,
) -> Assessment:
    """Evaluate the suit in every condition: rigid; shifted, yielding and both, with every arm cuff and the waist cuff.

    Muscles are solved in every N-th frame; progress(what, done, total) counts frames. External loads act in every
    scenario, also with the slack cord. There are no intervals; solver.uncertainty.total adds those of drawn people.
    Raises SuitError without an arm cuff, with two waist cuffs, for a suit that does not fit or whose cord is always
    slack; MotionError for a motion that leaves the range of a joint; ModelError for elastic tendons in some frames.
    """
    arms, waist = _arms_and_waist(cuffs)
    suited = prepare_suited_motion(motion, suit, every)
    suited.ensure_pulls()
    scenarios = _scenarios(suit, arms, waist)
    slack, efforts = solve_scenarios(suited, scenarios, partial(progress, "solving muscles"))
    bare = solve_without_suit(suited, slack)
    readouts = _read(suited, slack, scenarios, efforts)
    everything = [slack, bare, *efforts]
    return Assessment(
        muscles=motion.model.muscle_names,
        time=suited.problem.time,
        rest_lengths=suit.rest_lengths,
        reference_rest_length=suit.reference_rest_length,
        bare_body_cost=float(bare.muscles[0]),
        longest_cord=suited.slack_rest_length(scenarios[0]),
        waist_cuff=waist.name if waist else None,
        slack=slack.activations[0],
        curves=tuple(
            _curve(suited.measured, scenario, effort, reading)
            for scenario, effort, reading in zip(scenarios, efforts, readouts, strict=True)
        ),
        comparisons=_comparisons(arms, scenarios, readouts),
        uncertainty=None,
        scenarios=sum(len(effort.muscles) for effort in everything),
        outcomes=_outcomes(everything),
        muscle_outcomes=_muscle_outcomes(suited),
        has_glenoid_cone=suited.motion.options.has_glenoid_cone,
    )


def _text(figure: Quantity, field: str) -> str:
    """The figure with its interval, lengths in mm."""
    scale, digits = (1e3, 0) if field in ("rest_length", "permissible_error") else (1.0, 3)
    return "–" if figure.value is None else bracketed(figure.value, figure.ci95, scale, digits, figure.censored)


def _row(curve: EffortCurve) -> dict[str, float]:
    """Figures of a curve by column, each followed by the ends of its interval."""
    row: dict[str, float] = {}
    for column, field in TABLE.items():
        figure = curve.figures[field]
        ends = figure.ci95 or (np.nan, np.nan)
        row |= {column: np.nan if figure.value is None else figure.value}
        row |= {f"{column}_ci95_low": ends[0], f"{column}_ci95_high": ends[1]}
    return row


def _arms_and_waist(cuffs: Iterable[CuffParameters]) -> tuple[list[CuffParameters], CuffParameters | None]:
    arms, waists = by_site(cuffs)
    if not arms or len(waists) > 1:
        found = ", ".join(f"{cuff.name} ({cuff.site})" for cuff in (*arms, *waists)) or "none"
        raise SuitError(
            f"an assessment needs arm cuffs and at most one waist cuff and has {found}; fit what is missing",
            SolverCode.NO_ARM_CUFF,
        )
    return arms, waists[0] if waists else None


def _scenarios(suit: Suit, arms: list[CuffParameters], waist: CuffParameters | None) -> list[SuitScenario]:
    """Rigid first, then all cuffs in all conditions; the reference rest length is the last."""
    lengths = np.append(suit.rest_lengths, suit.reference_rest_length)
    yielding = [
        SuitScenario(condition, waist, arm, lengths, with_slopes=True) for arm in arms for condition in CUFF_CONDITIONS
    ]
    return [SuitScenario("rigid", None, None, lengths), *yielding]


def _read(
    suited: SuitedMotion, slack: ScenarioEffort, scenarios: Sequence[SuitScenario], efforts: Sequence[ScenarioEffort]
) -> list[CurveReadouts]:
    """Readouts of all scenarios; the loss of cord force is relative to the same cuffs without migration."""
    rigid, *others = zip(scenarios, efforts, strict=True)
    readouts = list(read_off_curves(suited, slack, {"rigid": rigid}, ("rigid",)).values())
    for cuff in range(0, len(others), len(CUFF_CONDITIONS)):
        own = dict(zip(CUFF_CONDITIONS, others[cuff : cuff + len(CUFF_CONDITIONS)], strict=True))
        readouts += list(read_off_curves(suited, slack, {"rigid": rigid, **own}).values())
    return readouts


def _place(scenario: SuitScenario) -> Place:
    return scenario.condition, scenario.arm.name if scenario.arm else None


def _curve(
    measured: Sequence[str], scenario: SuitScenario, effort: ScenarioEffort, reading: CurveReadouts
) -> EffortCurve:
    condition, cuff = _place(scenario)
    return EffortCurve(
        condition=condition,
        cuff=cuff,
        cost=effort.muscles[:-1],
        reserve_cost=effort.reserves[:-1],
        activations=effort.activations[-1],
        unsolved=effort.unsolved,
        figures={name: _quantity(getattr(reading, name)[0]) for name in FIGURES},
        reduction={name: _quantity(reading.reduction[0, i]) for i, name in enumerate(measured)},
    )


def _comparisons(
    arms: Sequence[CuffParameters], scenarios: Sequence[SuitScenario], readouts: Sequence[CurveReadouts]
) -> tuple[Comparison, ...]:
    cost = {_place(w)[1]: r.at_reference[0] for w, r in zip(scenarios, readouts, strict=True) if w.condition == "both"}
    pairs = combinations([arm.name for arm in arms], 2)
    return tuple(Comparison((a, b), _quantity(cost[a] - cost[b])) for a, b in pairs)


def _quantity(value: float) -> Quantity:
    return Quantity(None if np.isnan(value) else float(value))


def _outcomes(efforts: Sequence[ScenarioEffort]) -> dict[FrameOutcome, int]:
    together = np.concatenate([effort.outcomes.ravel() for effort in efforts])
    counts = {outcome: int((together == outcome).sum()) for outcome in FrameOutcome}
    return {outcome: count for outcome, count in counts.items() if count and outcome is not FrameOutcome.SOLVED}


def _muscle_outcomes(suited: SuitedMotion) -> dict[MuscleOutcome, int]:
    counts = {
        outcome: int((suited.mechanics.muscle_outcomes == outcome).any(axis=1).sum()) for outcome in MuscleOutcome
    }
    return {outcome: count for outcome, count in counts.items() if count and outcome is not MuscleOutcome.CONVERGED}
