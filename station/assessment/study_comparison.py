"""Difference between an assessment and the source study, by exchanging one part at a time.

The study ("Effect of Cuff Compliance on Muscle Activation in a Passive Shoulder-Exotendon Suit", table 3) has rigid
cuffs on one recorded motion. That motion is not bundled, so the bundled raise of the arm takes its place.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from solver.cuff import CuffParameters, by_site
from solver.errors import SolverError
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.assessment import Assessment, assess
from solver.suit.suit import Suit
from station.assessment.assessment_inputs import AssessmentInputs
from station.assessment.assessment_json import KnownNumberEntry, NumberEntry, StrictEntry
from station.assessment.findings import arm_efforts
from station.sources import BUNDLED, resolve_kinematics

if TYPE_CHECKING:
    from station.assessment.case import AssessedCase  # the compiler behind it takes long to import

STUDY_REST_LENGTH, STUDY_EFFORT = 0.74, 0.79
"""Best rest length [m] and effort there, relative to a slack cord, with rigid cuffs."""
FRAMES, REST_LENGTHS = 40, 16
"""Frames and rest lengths of each assessment, at most."""


class AnswerEntry(StrictEntry):
    """The best rest length and the effort there; null where it is at an end of the range that was tried.

    exchanged: what is not the session's own
    """

    exchanged: str
    rest_length_m: NumberEntry
    effort: NumberEntry


class StudyComparisonEntry(StrictEntry):
    """The study's answer, and those with this arm cuff, migration and compliance: the session's own first, then with
    one part exchanged, and with all of them.

    interaction: what the exchange of all changes beyond the sum of what the single exchanges change
    """

    cuff: str
    study_rest_length_m: KnownNumberEntry
    study_effort: KnownNumberEntry
    answers: list[AnswerEntry]
    interaction_rest_length_m: NumberEntry | None = None
    interaction_effort: NumberEntry | None = None


def compare_with_study(
    case: AssessedCase, inputs: AssessmentInputs, worn: Sequence[CuffParameters], assessment: Assessment
) -> StudyComparisonEntry | None:
    """With the arm cuff of the least effort; None for another model, suit or load than the study's.

    Every answer is from a short assessment, so that differences between them are those of the exchanged part.
    """
    cuff = _best_arm(assessment)
    is_of_study = inputs.model == BUNDLED and inputs.has_bundled_suit and inputs.external_loads is None
    if cuff is None or not is_of_study:
        return None
    arms, waists = by_site(worn)
    pair = [*waists, *(arm for arm in arms if arm.name == cuff)]
    own, model = replace(case, suit=_shortened(case.suit)), inputs.read_model()
    bundled, suit = resolve_kinematics(None, model), inputs.read_suit(len(own.suit.rest_lengths))
    study = replace(case, model=model, kinematics=bundled, suit=suit)
    settings = [("nothing", own, cuff), ("cuffs", own, None)]
    if case.subject is not None:
        settings.append(("body", replace(own, model=model), cuff))
    if case.subject is not None or inputs.motion is not None:
        settings.append(("motion", replace(own, kinematics=resolve_kinematics(None, own.model)), cuff))
    if case.spread is not None:
        settings.append(("cord", replace(own, suit=study.suit), cuff))
    settings.append(("all", study, None))
    answers = [_answer(part, setting, pair, worn_cuff) for part, setting, worn_cuff in settings]
    return StudyComparisonEntry(
        cuff=cuff,
        study_rest_length_m=KnownNumberEntry(value=STUDY_REST_LENGTH, ci95=None, censored=None),
        study_effort=KnownNumberEntry(value=STUDY_EFFORT, ci95=None, censored=None),
        answers=answers,
        interaction_rest_length_m=_interaction([answer.rest_length_m.value for answer in answers]),
        interaction_effort=_interaction([answer.effort.value for answer in answers]),
    )


def _interaction(answers: Sequence[float | None]) -> NumberEntry:
    """Of the session's own answer, those with one part exchanged, and that with all; unknown where one of them is."""
    known = [answer for answer in answers if answer is not None]
    if len(known) < len(answers):
        return _number(None)
    own, *single, all_exchanged = known
    return _number(all_exchanged - own - sum(answer - own for answer in single))


def _best_arm(assessment: Assessment) -> str | None:
    """The arm cuff with the least effort at its best rest length."""
    known = arm_efforts(assessment, "lowest_cost")
    return min(known, key=known.__getitem__) if known else None


def _shortened(suit: Suit) -> Suit:
    first, last = suit.rest_lengths[[0, -1]]
    return replace(suit, rest_lengths=np.linspace(first, last, min(REST_LENGTHS, len(suit.rest_lengths))))


def _answer(part: str, setting: AssessedCase, worn: Sequence[CuffParameters], cuff: str | None) -> AnswerEntry:
    """With this arm cuff, migration and compliance, or with rigid cuffs; unknown where the exchanged part is refused,
    as a motion beyond the range of the other body's joints.
    """
    every = math.ceil(len(setting.kinematics.time) / FRAMES)
    try:
        found = assess(LoadedMotion(setting.model, setting.kinematics), setting.suit, worn, every=every)
    except SolverError:
        return AnswerEntry(exchanged=part, rest_length_m=_number(None), effort=_number(None))
    condition = "rigid" if cuff is None else "both"
    curve = next(curve for curve in found.curves if (curve.condition, curve.cuff) == (condition, cuff))
    length, effort = curve.figures["rest_length"].value, curve.figures["lowest_cost"].value
    return AnswerEntry(exchanged=part, rest_length_m=_number(length), effort=_number(effort))


def _number(value: float | None) -> NumberEntry:
    return NumberEntry(value=value, ci95=None, censored=None)
