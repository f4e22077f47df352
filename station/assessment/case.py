"""Body, motion and suit of an assessment: the bundled ones, those of files, or the wearer's own."""

from __future__ import annotations

from dataclasses import dataclass

from documents.message import Message
from solver.model import Model
from solver.motion import Kinematics
from solver.personalisation.anthropometry import ARM_SEGMENTS, has_arm_segments
from solver.suit.suit import Suit
from solver.uncertainty.varied_motion import DrawnMotion
from station.assessment.assessment_inputs import AssessmentInputs
from station.errors import UnusedOption
from station.messages.assessment_messages import InputCode
from station.progress import Progress, silent
from station.subject.assessed_subject import AssessedSubject, build_subject, fit_suit


@dataclass(frozen=True, eq=False)
class AssessedCase:
    """Inputs of one assessment. drawn are bodies and motions within the uncertainty of the markers, of a wearer only.

    spread of each suit marker about its point [m], empty where the suit's points are those of its file
    """

    model: Model
    kinematics: Kinematics
    suit: Suit
    drawn: tuple[DrawnMotion, ...] = ()
    subject: AssessedSubject | None = None
    spread: dict[str, float] | None = None


def read_case(
    inputs: AssessmentInputs, most_rest_lengths: int | None = None, progress: Progress = silent
) -> AssessedCase:
    """Raises the sentence of the part that cannot be used."""
    generic, suit = inputs.read_model(), inputs.read_suit(most_rest_lengths)
    if inputs.subject is None:
        return AssessedCase(generic, inputs.read_motion(generic), suit)
    if not has_arm_segments(generic):
        bodies = ", ".join(body for segment in ARM_SEGMENTS.values() for body in segment.bodies)
        raise UnusedOption(Message(InputCode.NO_ARM_OF_SUBJECT, {"model": generic.name, "bodies": bodies}))
    subject = build_subject(inputs.subject, generic, progress)
    digitised = fit_suit(subject, suit)
    own, spread = (suit, None) if digitised is None else (digitised.suit, dict(digitised.spread))
    return AssessedCase(subject.model, subject.kinematics, own, subject.drawn, subject, spread)
