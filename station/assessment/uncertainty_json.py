"""Drawn people in assessment.json: what its intervals are from, and the decision on a cuff; the people as a table.

The budget's spread between donnings is estimated where donnings were repeated, and otherwise as declared.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from documents.message import Figures, Message
from fitting.cuffs.cuffs_file import CUFFS_FILE, read_cuffs_document
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.study.cuff_study import Observation
from fitting.study.donning_spread import DonningSpreadEstimate, SpreadOutcome, estimate_donning_spread
from solver.suit.assessment import UncertaintySummary
from solver.suit.decision import Basis, CuffDecision, DecisionOutcome, DecisionRule, PairProbability
from solver.suit.quantity import TAIL
from solver.suit.scenarios import FIGURES
from solver.uncertainty.indices import SobolIndices
from solver.uncertainty.sources import GROUPS, DonningSpread, Group
from solver.uncertainty.total import DrawnPeople, IndexedFigure
from station.assessment.assessment_json import (
    CURVE_KEYS,
    CountEntry,
    KnownNumberEntry,
    NumberEntry,
    Real,
    StrictEntry,
    count,
    exact_number,
    finite,
)
from station.checksums import file_sha256
from station.messages.assessment_messages import DecisionCode, InputCode
from station.study.sessions import StudySession, read_session, read_sessions, refuse_mixed, select_measurements

PEOPLE_FILE = "people.csv"
UNITS = {
    "at_reference": "effort_at_reference",
    "rest_length": "best_rest_length_m",
    "lowest_cost": "effort_at_best",
    "permissible_error": "permissible_error_m",
    **CURVE_KEYS,
}
"""Field of CurveReadouts → column of people.csv."""
CERTAIN = 0.995
"""Above it the percentage is "> 99": draws do not resolve certainty."""


class DonningEntry(StrictEntry):
    """Relative spread of a quantity between donnings: estimated from repeated donnings, or that of the budget."""

    is_estimated: bool
    outcome: str
    spread: KnownNumberEntry
    degrees_of_freedom: NumberEntry
    donnings: CountEntry
    cuffs: CountEntry


@dataclass(frozen=True)
class DonningSources:
    """The declared spread, and of every quantity its estimate."""

    declared: DonningSpread
    estimates: Mapping[str, DonningSpreadEstimate]

    @property
    def spread(self) -> DonningSpread:
        """For the solver."""
        used = {
            quantity: estimate.spread if self.is_estimated(quantity) else getattr(self.declared, quantity)
            for quantity, estimate in self.estimates.items()
        }
        stiffness, damping, migration = (
            estimate.freedom if self.is_estimated(quantity) else inf for quantity, estimate in self.estimates.items()
        )
        return DonningSpread(**used, freedom=(stiffness, damping, migration))

    def is_estimated(self, quantity: str) -> bool:
        """Whether the estimate is used in place of the declared spread."""
        return self.estimates[quantity].outcome is SpreadOutcome.ESTIMATED

    @property
    def message(self) -> Message[InputCode]:
        """Spread and its origin for every quantity."""
        figures: Figures = {quantity: self._text(quantity) for quantity in self.estimates}
        return Message(InputCode.DONNING_SPREAD, figures)

    @property
    def entries(self) -> dict[str, DonningEntry]:
        """By quantity."""
        return {quantity: self._entry(quantity, estimate) for quantity, estimate in self.estimates.items()}

    def _entry(self, quantity: str, estimate: DonningSpreadEstimate) -> DonningEntry:
        is_estimated = self.is_estimated(quantity)
        ends = [float(end) for end in estimate.ci95] if is_estimated and np.isfinite(estimate.ci95).all() else None
        return DonningEntry(
            is_estimated=is_estimated,
            outcome=estimate.outcome.value,
            spread=KnownNumberEntry(value=getattr(self.spread, quantity), ci95=ends),
            degrees_of_freedom=NumberEntry(value=estimate.freedom if is_estimated else None, ci95=None),
            donnings=count(estimate.donnings),
            cuffs=count(estimate.cuffs),
        )

    def _text(self, quantity: str) -> str:
        estimate, percent = self.estimates[quantity], 100 * getattr(self.spread, quantity)
        if not self.is_estimated(quantity):
            return f"{quantity} {percent:.2g} % (declared)"
        low, high = (f"{100 * end:.2g}" for end in estimate.ci95)
        return f"{quantity} {percent:.2g} % (95 % CI {low} to {high}, {estimate.donnings} donnings)"


def donning_sources(
    declared: DonningSpread, cuffs: Path, chosen: Sequence[Path] = (), *, estimates: bool = True
) -> DonningSources:
    """Estimate the spread from the donnings of cuffs.json and of further session folders; without `estimates`, from
    none. Raises StudyError for a folder that is no session, or for measured sessions mixed with simulated ones.
    """
    sessions = _sessions(cuffs, chosen) if estimates else []
    found: dict[str, DonningSpreadEstimate] = {}
    for quantity in QUANTITIES:
        measurements: list[Observation] = []
        for session in sessions:
            by_cuff, _ = select_measurements(session, quantity)
            measurements += [one for values in by_cuff.values() for one in values]
        found[quantity] = estimate_donning_spread(measurements)
    return DonningSources(declared, found)


def _sessions(cuffs: Path, chosen: Sequence[Path]) -> list[StudySession]:
    """That of cuffs.json, which may be written by hand and have no volunteer, then the others."""
    own = read_session(cuffs.parent) if cuffs.name == CUFFS_FILE else None
    if not isinstance(own, StudySession):
        own = StudySession(cuffs.parent, "", "", "", read_cuffs_document(cuffs), file_sha256(cuffs))
    others = read_sessions(chosen).sessions if chosen else ()
    sessions = [own, *(session for session in others if session.folder.resolve() != own.folder.resolve())]
    refuse_mixed(sessions)
    return sessions


class GroupIndexEntry(StrictEntry):
    """Sobol indices of a group of sources: first order and total, each with its bootstrap interval."""

    first: NumberEntry
    total: NumberEntry


class IndicesEntry(StrictEntry):
    """Shares of the variance of a figure: of one arm cuff, or of the first less the second of two."""

    figure: str
    cuffs: list[str]
    variance: KnownNumberEntry
    blocks: CountEntry
    groups: dict[str, GroupIndexEntry]


class UncertaintyEntry(StrictEntry):
    """Basis of the intervals: the number of people drawn, of those solved in every condition, in every N-th
    frame, and of those left out because their muscles cannot do the motion. content is the part of all people inside
    an interval, with the bounds that so many people give.
    """

    people: CountEntry
    seed: CountEntry
    solved: CountEntry
    infeasible: CountEntry
    every_frame: CountEntry
    sources: Annotated[list[Group], Field(min_length=1)]
    content: KnownNumberEntry
    subsampling_difference: dict[str, NumberEntry]
    index_blocks: CountEntry
    indices: list[IndicesEntry] = Field(default_factory=list)
    donning: dict[str, DonningEntry] = Field(default_factory=dict)


def uncertainty_entry(
    summary: UncertaintySummary, people: DrawnPeople, donning: DonningSources | None
) -> UncertaintyEntry:
    """The block "uncertainty" of the file."""
    difference = summary.largest_difference
    return UncertaintyEntry(
        people=count(summary.people),
        seed=count(people.seed),
        solved=count(summary.solved),
        infeasible=count(summary.infeasible),
        every_frame=count(summary.every),
        sources=[source for source in GROUPS if source in summary.sources],
        content=KnownNumberEntry(value=1 - 2 * TAIL, ci95=list(summary.content)),
        subsampling_difference={
            "at_rigid_optimum": finite(difference["at_reference"]),
            "rest_length_m": finite(difference["rest_length"]),
            "normalised_cost": finite(difference["lowest_cost"]),
            "permissible_error_m": finite(difference["permissible_error"]),
        },
        index_blocks=count(people.index_blocks),
        indices=[
            _indices(figure, cuffs, found) for (figure, cuffs), found in people.indices.items() if found is not None
        ],
        donning={} if donning is None else donning.entries,
    )


def people_table(people: DrawnPeople) -> str:
    """CSV: person (0 is the assessed one, solved as the others are), condition, cuff, figures of the curve, outcome."""
    lines = [",".join(["person", "condition", "cuff", *(UNITS[name] for name in FIGURES), "outcome"])]
    for (condition, cuff), reading in people.readouts.items():
        for person, row in enumerate(zip(*(getattr(reading, name) for name in FIGURES), strict=True)):
            numbers = [f"{value:.8g}" for value in row]
            lines.append(",".join([str(person), condition, cuff or "", *numbers, str(reading.outcome[person])]))
    return "\n".join(lines) + "\n"


def _indices(figure: str, cuffs: tuple[str, ...], found: SobolIndices) -> IndicesEntry:
    def index(value: float, half_width: float) -> NumberEntry:
        return NumberEntry(value=float(value), ci95=[float(value - half_width), float(value + half_width)])

    rows = zip(found.groups, found.first, found.first_half_width, found.total, found.total_half_width, strict=True)
    return IndicesEntry(
        figure=figure,
        cuffs=list(cuffs),
        variance=exact_number(found.variance),
        blocks=count(found.blocks),
        groups={
            group: GroupIndexEntry(first=index(first, first_half), total=index(total, total_half))
            for group, first, first_half, total, total_half in rows
        },
    )


class PairEntry(StrictEntry):
    """Two cuffs: efforts of the first less those of the second, relative to a slack cord, and three probabilities."""

    cuffs: Annotated[list[str], Field(min_length=2, max_length=2)]
    difference: KnownNumberEntry
    first_saves_more: KnownNumberEntry
    second_saves_more: KnownNumberEntry
    equivalent: KnownNumberEntry


class SettleEntry(StrictEntry):
    """For an open decision: the group of sources with the largest expected reduction of variance, if known."""

    code: Annotated[DecisionCode, Field(strict=False)]
    figures: dict[str, Real | str]
    text: str


class BasisEntry(StrictEntry):
    """The decision on one basis. leading, worse and undecided are cuffs; text is the sentence of code and figures."""

    code: Annotated[DecisionCode, Field(strict=False)]
    leading: list[str] = Field(default_factory=list)
    worse: list[str] = Field(default_factory=list)
    undecided: list[str] = Field(default_factory=list)
    probability: NumberEntry = Field(default_factory=lambda: NumberEntry(value=None))
    pairs: list[PairEntry] = Field(default_factory=list)
    figures: dict[str, Real | str] = Field(default_factory=dict)
    text: str
    settle: SettleEntry | None = None


class DecisionEntry(StrictEntry):
    """Choice of the cuff. contains: "fit" if only the uncertainty of the fit is known, "total" with a budget.

    people  drawn from the budget; relevant_difference is the smallest effect of interest, relative to a slack cord
    """

    contains: Literal["fit", "total"]
    people: CountEntry
    relevant_difference: KnownNumberEntry
    certainty: KnownNumberEntry
    at_reference: BasisEntry
    at_best: BasisEntry


def decision_entry(
    summary: UncertaintySummary, indices: Mapping[IndexedFigure, SobolIndices | None], reference_rest_length: float
) -> DecisionEntry:
    """The decision from the efforts of drawn people; reference_rest_length [m]."""
    rule, drawn = summary.rule, summary.people
    places: dict[Basis, str] = {
        "at_reference": f"At {reference_rest_length:.3f} m",
        "at_best": "Each at its own best rest length",
    }
    found: dict[Basis, BasisEntry] = {}
    for basis, decision in summary.decisions.items():
        message = decision_message(decision, rule, drawn, places[basis])
        found[basis] = _basis(decision, message, _settle(decision, basis, indices))
    return _decision("total", rule, drawn, found["at_reference"], found["at_best"])


def without_decision(*, can_draw_people: bool) -> DecisionEntry:
    """No decision, because the fit of one donning does not contain what differs between days and people.

    can_draw_people: False with elastic tendons, with which people are refused
    """
    message = Message(DecisionCode.FIT_ONLY if can_draw_people else DecisionCode.NO_PEOPLE)
    entry = BasisEntry(code=message.code, text=str(message))
    return _decision("fit", DecisionRule(), 0, entry, entry)


def decision_message(decision: CuffDecision, rule: DecisionRule, drawn: int, at: str) -> Message[DecisionCode]:
    """Code and figures; `at` names the basis at the beginning of the sentence."""
    figures: Figures = {
        "at": at,
        "leading": listed(decision.leading),
        "worse": listed(decision.worse),
        "relevant_points": 100 * rule.relevant_difference,
        "people": decision.people,
        "drawn": drawn,
    }
    if decision.outcome is DecisionOutcome.UNDECIDED:
        return Message(DecisionCode.UNDECIDED, {**figures, **_rival(decision)})
    if decision.probability is not None:
        figures = {**figures, "percent": percent(decision.probability)}
    if decision.outcome is DecisionOutcome.EQUIVALENT and decision.worse:
        return Message(DecisionCode.EQUIVALENT_AND_WORSE, figures)
    return Message(DecisionCode(f"decision.{decision.outcome}"), figures)


def listed(names: Sequence[str]) -> str:
    """`a`, `a and b`, `a, b and c`."""
    *others, last = names or ("",)
    return f"{', '.join(others)} and {last}" if others else last


def percent(probability: float) -> str:
    """A probability in whole per cent."""
    if probability > CERTAIN:
        return "> 99"
    return "< 1" if probability < 1 - CERTAIN else f"{100 * probability:.0f}"


def _decision(
    contains: Literal["fit", "total"], rule: DecisionRule, people: int, at_reference: BasisEntry, at_best: BasisEntry
) -> DecisionEntry:
    return DecisionEntry(
        contains=contains,
        people=count(people),
        relevant_difference=exact_number(rule.relevant_difference),
        certainty=exact_number(rule.certainty),
        at_reference=at_reference,
        at_best=at_best,
    )


def _basis(decision: CuffDecision, message: Message[DecisionCode], settle: SettleEntry | None) -> BasisEntry:
    return BasisEntry(
        code=message.code,
        leading=list(decision.leading),
        worse=list(decision.worse),
        undecided=list(decision.undecided),
        probability=NumberEntry(value=decision.probability, ci95=None),
        pairs=[_pair(pair) for pair in decision.pairs],
        figures=dict(message.figures),
        text=str(message),
        settle=settle,
    )


def _pair(pair: PairProbability) -> PairEntry:
    return PairEntry(
        cuffs=list(pair.cuffs),
        difference=KnownNumberEntry(value=pair.difference, ci95=list(pair.ci95)),
        first_saves_more=exact_number(pair.first_saves_more),
        second_saves_more=exact_number(pair.second_saves_more),
        equivalent=exact_number(pair.equivalent),
    )


def _settle(
    decision: CuffDecision, basis: Basis, indices: Mapping[IndexedFigure, SobolIndices | None]
) -> SettleEntry | None:
    """The group with the largest expected reduction of the variance of the open difference, its first-order index; a
    code of its own where no share is known to differ from zero. None for a decision that is not open.
    """
    if decision.outcome is not DecisionOutcome.UNDECIDED:
        return None
    first, second = decision.leading[0], str(_rival(decision)["rival"])
    code = DecisionCode.SETTLE_UNKNOWN
    figures: Figures = {"first": first, "second": second}
    for (figure, cuffs), found in indices.items():
        if figure == f"difference_{basis}" and set(cuffs) == {first, second} and found is not None:
            largest = int(np.argmax(found.first))
            group, share = found.groups[largest], float(found.first[largest])
            if share > found.first_half_width[largest]:
                code = DecisionCode(f"settle.{group}")
                figures = {"group": group, "percent": percent(share), "first": cuffs[0], "second": cuffs[1]}
    return SettleEntry(code=code, figures=dict(figures), text=code.sentence(figures))


def _rival(decision: CuffDecision) -> Figures:
    """The undecided cuff whose statements are least certain, with the probabilities from the leading cuff's side."""
    lead = decision.leading[0]
    pairs = {next(name for name in pair.cuffs if name != lead): pair for pair in decision.pairs if lead in pair.cuffs}
    rival = min(decision.undecided, key=lambda name: _certainty(pairs[name]))
    pair = pairs[rival]
    ahead, behind = pair.first_saves_more, pair.second_saves_more
    if pair.cuffs[0] != lead:
        ahead, behind = behind, ahead
    return {
        "rival": rival,
        "first_percent": percent(ahead),
        "equivalent_percent": percent(pair.equivalent),
        "second_percent": percent(behind),
    }


def _certainty(pair: PairProbability) -> float:
    return max(pair.first_saves_more, pair.second_saves_more, pair.equivalent)
