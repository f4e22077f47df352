"""The cord's tension that the load cell measured on the wearer, beside the predicted one."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from solver.cuff import CuffParameters
from solver.inverse_kinematics.marker_fit import longest_whole_motion
from solver.motion import differentiate
from solver.suit.cord_check import CordCheck, check_cord
from solver.suit.suit import Suit
from station.messages.subject_codes import SubjectCode
from station.subject.assessed_subject import AssessedSubject
from station.subject.subject_file import refuse_subject


def worn_arm_cuff(named: str | None, arms: Sequence[str]) -> str | None:
    """The arm cuff that counts as worn, live and where a measured cord is compared: the one that is named, else the
    only one that was fitted; None, rigid cuffs, where none or several were.
    """
    return named or (arms[0] if len(arms) == 1 else None)


def compare_cord(
    subject: AssessedSubject, suit: Suit, cuffs: Mapping[str, CuffParameters], waist: str | None
) -> CordCheck | None:
    """In the trial with a tight cord; None where its tension or its rest length is not known.

    cuffs are the fitted ones by name, of which subject.toml names the arm cuff that was worn (worn_arm_cuff). Raises
    SubjectError for one that was not fitted.
    """
    cord = subject.declared.cord
    tight = [trial for trial in subject.trials if trial.manifest.condition == "tight" and trial.body.is_cord_measured]
    if cord is None or cord.rest_length_m is None or not tight:
        return None
    if cord.cuff is not None and cord.cuff not in cuffs:
        raise refuse_subject(SubjectCode.UNKNOWN_CUFF, cuff=cord.cuff, known=", ".join(cuffs))
    trial = tight[0]
    motion = longest_whole_motion(subject.model, trial.time, subject.postures(trial)).motion
    measured = np.interp(motion.time, trial.force_time, trial.force)
    arm = worn_arm_cuff(cord.cuff, [name for name, cuff in cuffs.items() if cuff.site == "arm"])
    worn = (cuffs[waist] if waist else None, cuffs[arm]) if arm else (None, None)
    at_rest = replace(suit, reference_rest_length=cord.rest_length_m)
    return check_cord(at_rest, subject.model, differentiate(motion), measured, worn)
