"""The sentences of the station's messages, in one place; programs use the codes.

A message states what happened, what it means and what to do, in the terms of the bench.
"""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum

from station.messages.assessment_file_messages import ASSESSMENT_FILE
from station.messages.assessment_sentences import ASSESSMENT
from station.messages.bench_sentences import BENCH
from station.messages.decision_sentences import DECISIONS
from station.messages.emg_messages import EMG
from station.messages.file_sentences import FILES
from station.messages.kinematics_sentences import KINEMATICS
from station.messages.live_messages import LIVE
from station.messages.person_messages import PERSON_SENTENCES
from station.messages.session_sentences import SESSION
from station.messages.setup_messages import SETUP
from station.messages.study_messages import STUDY
from station.messages.subject_messages import SUBJECT
from station.messages.sweep_messages import SWEEPS
from station.messages.validation_messages import VALIDATION
from station.messages.wearer_sentences import WEARER_SENTENCES

SENTENCES: Mapping[StrEnum, str] = {
    **BENCH,
    **SESSION,
    **KINEMATICS,
    **PERSON_SENTENCES,
    **ASSESSMENT,
    **ASSESSMENT_FILE,
    **DECISIONS,
    **EMG,
    **FILES,
    **LIVE,
    **SETUP,
    **STUDY,
    **SUBJECT,
    **SWEEPS,
    **VALIDATION,
    **WEARER_SENTENCES,
}
"""Code → template, filled with the figures of the message."""
