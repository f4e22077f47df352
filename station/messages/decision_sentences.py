"""Sentences on the choice of a cuff."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.codes import DecisionCode

_EQUIVALENT = "{at}, {leading}: equivalent within {relevant_points:g} points of effort (probability {percent} %)"
_SETTLE = "{group} explains {percent} % of the variance of {first} − {second}, the largest share; to reduce it, "
DECISIONS: Mapping[StrEnum, str] = {
    DecisionCode.CHOOSE: (
        "{at}, choose {leading}: it saves at least {relevant_points:g} points of effort more than {worse} "
        "(probability {percent} %)."
    ),
    DecisionCode.EQUIVALENT: _EQUIVALENT + "; choose by comfort or migration.",
    DecisionCode.EQUIVALENT_AND_WORSE: (
        _EQUIVALENT + ", and each saves at least {relevant_points:g} points more than {worse}; choose by comfort "
        "or migration."
    ),
    DecisionCode.UNDECIDED: (
        "{at}, undecided: {leading} has the least mean effort. It saves at least {relevant_points:g} points more than "
        "{rival} with a probability of {first_percent} %, is equivalent to it with {equivalent_percent} %, and saves "
        "at least {relevant_points:g} points less with {second_percent} %."
    ),
    DecisionCode.ONLY_CUFF: "{at}, {leading} is the only cuff; there is no other to compare it with.",
    DecisionCode.UNKNOWN: (
        "{at}, no decision: only {people:.0f} of {drawn:.0f} drawn people have a solution for every cuff."
    ),
    DecisionCode.SETTLE_FIT: _SETTLE + "repeat the trials of the cuffs.",
    DecisionCode.SETTLE_DONNING: _SETTLE + "measure more donnings of each cuff.",
    DecisionCode.SETTLE_BODY: _SETTLE + "measure the wearer's body and the points of the cord (--subject).",
    DecisionCode.SETTLE_MUSCLES: _SETTLE + "measure the wearer's strength, or compare with EMG.",
    DecisionCode.SETTLE_MOTION: _SETTLE + "record more cycles of the wearer's own motion (--subject).",
    DecisionCode.SETTLE_UNKNOWN: (
        "Which measurement would settle {first} − {second} is not known: no group of sources has a share of its "
        "variance that differs from zero. Run `station assess` with --indices 128 or more."
    ),
    DecisionCode.FIT_ONLY: (
        "No decision: the intervals do not contain the variation of donnings, bodies, muscles and motions. Assess "
        "again without `--people 0` and `--sources cuffs`."
    ),
    DecisionCode.NO_PEOPLE: (
        "No decision: people are not drawn with elastic tendons. Assess again without `--tendons elastic`, and compare "
        "how much effort the cuffs save with both."
    ),
}
