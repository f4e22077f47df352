"""Muscle effort saved by a suit in a motion, with rigid cuffs and with the fitted ones.

Cost is the sum of w a² over muscles and frames, relative to that of the suit with a slack cord.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, fields
from itertools import combinations
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters, by_site
from solver.model import Model
from solver.motion import Kinematics
from solver.multibody.external_loads import ExternalForce
from solver.redundancy.motion import FrameOutcome, RedundancyOptions
from solver.suit.readouts import CurveReadouts, read_off_curves
from solver.suit.scenarios import (
    CUFF_CONDITIONS,
    Condition,
    ScenarioEffort,
    SuitedMotion,
    SuitScenario,
    prepare_suited_motion,
    solve_scenarios,
    solve_without_suit,
)
from solver.suit.suit import Suit, SuitError
from solver.suit.uncertainty import DrawnScenarios, solve_draws

if TYPE_CHECKING:
    import pandas as pd

Array = NDArray[np.float64]
Progress = Callable[[str, int, int], None]


@dataclass(frozen=True)
class Quantity:
    """A number with its 95 % interval; None for a missing interval or number."""

    value: float | None
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True, eq=False)
class EffortCurve:
    """One condition over the rest lengths, and what is read off it.

    cuff          the arm cuff's name, None in the rigid condition
    cost          (rest lengths,) normalised cost of the muscles;  reserve_cost (rest lengths,) of the reserves
    activations   (frames, muscles) at the reference rest length
    unsolved      (frame, rest length) pairs that did not come out solved
    figures       name of a field of Readings → its figure, each with the unit given there
    reduction     muscle or group of muscles → its figure of Readings.reduction
    """

    condition: Condition
    cuff: str | None
    cost: Array
    reserve_cost: Array
    activations: Array
    unsolved: int
    figures: Mapping[str, Quantity]
    reduction: Mapping[str, Quantity]


@dataclass(frozen=True)
class Comparison:
    """Two arm cuffs, both shifted and yielding: cost of the first less that of the second at the reference length."""

    cuffs: tuple[str, str]
    cost_difference: Quantity

    @property
    def differ(self) -> bool | None:
        """Whether the interval leaves out zero; None where nothing is known of it."""
        interval = self.cost_difference.ci95
        return None if interval is None else not interval[0] <= 0 <= interval[1]


@dataclass(frozen=True)
class UncertaintySummary:
    """How the intervals came about, and how far the thinner study of the draws is from the whole one.

    largest_difference  name of a field of Readings → largest |decimated − whole| over all conditions, NaN where one is
    """

    draws: int
    every: int
    largest_difference: Mapping[str, float]


@dataclass(frozen=True, eq=False, repr=False)
class Assessment:
    """Effort saved by the suit in one motion; costs are relative to the suit with a slack cord, which is 1.

    muscles         names, in the order of every such axis;  time (frames,) [s] of the activations
    rest_lengths    (rest lengths,) tried [m];  reference_rest_length [m]
    bare_body_cost  without the suit's masses
    longest_cord    longest the cord's line becomes [m]; at a greater rest length it never pulls
    waist_cuff      name of the cuff that yields at the waist, None for a rigid one
    slack           (frames, muscles) activations with a slack cord
    curves          rigid first, then each arm cuff in each condition
    uncertainty        None where no cuff carries an uncertainty, or no draws were asked for
    scenarios       whose frames were solved
    outcomes        sentence of each FrameOutcome but SOLVED → (frame, scenario) pairs that ended so
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
    outcomes: Mapping[str, int]

    def __repr__(self) -> str:
        rows = self.to_dataframe().to_string(index=False, float_format="{:.4g}".format)
        title = f"Assessment: {self.scenarios} scenarios, {self.unsolved} frames not solved; effort over a slack cord"
        return f"{title}\n{rows}"

    def to_dataframe(self) -> pd.DataFrame:
        """A row per curve: condition, cuff, least_effort over that with a slack cord, and rest_length_m where it is."""
        import pandas as pd

        best = [int(np.argmin(np.where(np.isfinite(curve.cost), curve.cost, np.inf))) for curve in self.curves]
        return pd.DataFrame(
            {
                "condition": [curve.condition for curve in self.curves],
                "cuff": [curve.cuff or "" for curve in self.curves],
                "least_effort": [curve.cost[k] for curve, k in zip(self.curves, best, strict=True)],
                "rest_length_m": [self.rest_lengths[k] for k in best],
            }
        )

    @property
    def unsolved(self) -> int:
        """(frame, scenario) pairs that did not come out solved."""
        return sum(self.outcomes.values())


def assess(
    model: Model,
    kinematics: Kinematics,
    suit: Suit,
    cuffs: Iterable[CuffParameters],
    *,
    every: int = 1,
    draws: int = 200,
    draw_every: int = 20,
    options: RedundancyOptions | None = None,
    loads: Sequence[ExternalForce] = (),
    progress: Progress = lambda *_: None,
) -> Assessment:
    """Evaluate the suit in every condition: rigid; shifted, yielding and both, with every arm cuff and the waist cuff.

    Muscles are solved in every N-th frame, those of the drawn cuffs in every draw_every-th; progress(what, done, total)
    counts them. External loads are sampled at all frames and act in every scenario, also with the slack cord. Raises
    SuitError without an arm cuff, with two waist cuffs, for a suit that does not fit or whose cord never pulls;
    MotionError for a motion that leaves the range of a joint.
    """
    arms, waist = _arms_and_waist(cuffs)
    worn = prepare_suited_motion(model, kinematics, suit, every, options, loads)
    worn.ensure_pulls()
    scenarios = _scenarios(suit, arms, waist)
    slack, efforts = solve_scenarios(worn, scenarios, lambda *count: progress("solving muscles", *count))
    bare = solve_without_suit(worn, slack)
    readouts = _read(worn, slack, scenarios, efforts)
    drawn = None
    if draws and any(cuff.covariance.any() for cuff in (waist, *arms) if cuff):
        decimated = prepare_suited_motion(model, kinematics, suit, draw_every, options, loads)
        spans = {_place(w): _span(suit, w, reading) for w, reading in zip(scenarios, readouts, strict=True)}
        drawn = solve_draws(decimated, waist, arms, draws, spans, lambda *count: progress("varying cuffs", *count))
    everything = [slack, bare, *efforts]
    return Assessment(
        muscles=model.muscle_names,
        time=worn.problem.time,
        rest_lengths=suit.rest_lengths,
        reference_rest_length=suit.reference_rest_length,
        bare_body_cost=float(bare.muscles[0]),
        longest_cord=worn.slack_rest_length(scenarios[0]),
        waist_cuff=waist.name if waist else None,
        slack=slack.activations[0],
        curves=tuple(
            _curve(worn.measured, scenario, effort, reading, drawn)
            for scenario, effort, reading in zip(scenarios, efforts, readouts, strict=True)
        ),
        comparisons=_comparisons(arms, scenarios, readouts, drawn),
        uncertainty=_uncertainty(scenarios, readouts, drawn),
        scenarios=sum(len(effort.muscles) for effort in everything),
        outcomes=_outcomes(everything),
    )


def _arms_and_waist(cuffs: Iterable[CuffParameters]) -> tuple[list[CuffParameters], CuffParameters | None]:
    arms, waists = by_site(cuffs)
    if not arms or len(waists) > 1:
        found = ", ".join(f"{cuff.name} ({cuff.site})" for cuff in (*arms, *waists)) or "none"
        raise SuitError(
            f"an assessment needs arm cuffs and at most one waist cuff and has {found}; fit what is missing"
        )
    return arms, waists[0] if waists else None


def _scenarios(suit: Suit, arms: list[CuffParameters], waist: CuffParameters | None) -> list[SuitScenario]:
    """Rigid first, then each cuff in each condition; the reference rest length comes after those tried."""
    lengths = np.append(suit.rest_lengths, suit.reference_rest_length)
    yielding = [SuitScenario(condition, waist, arm, lengths) for arm in arms for condition in CUFF_CONDITIONS]
    return [SuitScenario("rigid", None, None, lengths), *yielding]


def _read(
    worn: SuitedMotion, slack: ScenarioEffort, scenarios: Sequence[SuitScenario], efforts: Sequence[ScenarioEffort]
) -> list[CurveReadouts]:
    """Readings of every wearing; migration is seen against the same cuffs before they slipped."""
    rigid, *others = zip(scenarios, efforts, strict=True)
    readouts = list(read_off_curves(worn, slack, {"rigid": rigid}).values())
    for cuff in range(0, len(others), len(CUFF_CONDITIONS)):
        own = dict(zip(CUFF_CONDITIONS, others[cuff : cuff + len(CUFF_CONDITIONS)], strict=True))
        readouts += list(read_off_curves(worn, slack, {"rigid": rigid, **own}).values())[1:]
    return readouts


def _place(scenario: SuitScenario) -> tuple[Condition, str | None]:
    return scenario.condition, scenario.arm.name if scenario.arm else None


def _span(suit: Suit, scenario: SuitScenario, reading: CurveReadouts) -> tuple[float, float]:
    """Rest lengths that hold the optimum and its permissible error, and those of cuffs that are somewhat different,
    each with what the cuffs have slipped.
    """
    length, width = float(reading.rest_length[0]), float(reading.permissible_error[0])
    first, last = length - width, length + width
    if np.isnan(length + width):
        first, last = suit.rest_lengths[[0, -1]].tolist()
    return first + scenario.migration, last + scenario.migration


def _curve(
    measured: Sequence[str],
    scenario: SuitScenario,
    effort: ScenarioEffort,
    reading: CurveReadouts,
    drawn: DrawnScenarios | None,
) -> EffortCurve:
    condition, cuff = _place(scenario)
    versions = drawn.readouts[condition, cuff] if drawn and cuff else None
    names = [field.name for field in fields(CurveReadouts) if field.name != "reduction"]
    return EffortCurve(
        condition=condition,
        cuff=cuff,
        cost=effort.muscles[:-1],
        reserve_cost=effort.reserves[:-1],
        activations=effort.activations[-1],
        unsolved=effort.unsolved,
        figures={
            name: _figure(getattr(reading, name)[0], getattr(versions, name) if versions else None) for name in names
        },
        reduction={
            name: _figure(reading.reduction[0, i], versions.reduction[:, i] if versions else None)
            for i, name in enumerate(measured)
        },
    )


def _figure(value: float, versions: Array | None) -> Quantity:
    """versions (1 + draws,): of the fitted cuffs, then of the drawn ones, on fewer frames than the value."""
    if np.isnan(value):
        return Quantity(None)
    if versions is None or np.isnan(versions).any():
        return Quantity(float(value))
    low, high = np.quantile(versions[1:] - versions[0], [0.025, 0.975])
    # Where every other cuff makes it larger, as a lowest cost, the draws alone would leave the value itself out.
    return Quantity(float(value), (float(value + min(low, 0.0)), float(value + max(high, 0.0))))


def _comparisons(
    arms: Sequence[CuffParameters],
    scenarios: Sequence[SuitScenario],
    readouts: Sequence[CurveReadouts],
    drawn: DrawnScenarios | None,
) -> tuple[Comparison, ...]:
    cost = {_place(w)[1]: r.at_reference[0] for w, r in zip(scenarios, readouts, strict=True) if w.condition == "both"}
    compared = []
    for a, b in combinations([arm.name for arm in arms], 2):
        versions = None
        if drawn:
            versions = drawn.readouts["both", a].at_reference - drawn.readouts["both", b].at_reference
        compared.append(Comparison((a, b), _figure(cost[a] - cost[b], versions)))
    return tuple(compared)


def _uncertainty(
    scenarios: Sequence[SuitScenario], readouts: Sequence[CurveReadouts], drawn: DrawnScenarios | None
) -> UncertaintySummary | None:
    if drawn is None:
        return None
    names = ("at_reference", "rest_length", "lowest_cost", "permissible_error")
    largest = {}
    for name in names:
        decimated = [getattr(drawn.readouts[_place(scenario)], name)[0] for scenario in scenarios]
        # NaN if one of them is NaN; the result of max() would depend on their order
        largest[name] = float(
            np.max(np.abs(np.subtract(decimated, [getattr(readout, name)[0] for readout in readouts])))
        )
    return UncertaintySummary(drawn.count, drawn.every, largest)


def _outcomes(efforts: Sequence[ScenarioEffort]) -> dict[str, int]:
    together = np.concatenate([effort.outcomes.ravel() for effort in efforts])
    counts = {outcome.value: int((together == outcome).sum()) for outcome in FrameOutcome}
    return {sentence: count for sentence, count in counts.items() if count and sentence != FrameOutcome.SOLVED.value}
