"""subject.toml, beside the recordings of a session: what no marker shows of the wearer."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic import Field, ValidationError

from documents.plain_data import PlainDataError, parse_toml
from documents.regular_file import LARGEST_SUIT, describe_failure, read_regular
from documents.validation import NonNegative, Positive, Section, describe_error
from station.errors import StationError
from station.messages.message import Message
from station.messages.subject_codes import SubjectCode

SUBJECT_FILE = "subject.toml"


class SubjectError(StationError):
    """A folder from which no person can be assessed; one sentence."""


class Cord(Section):
    """The cord in the trials in which it was tight: its rest length, and the arm cuff that was worn."""

    rest_length_m: Positive
    cuff: str | None = None


class Subject(Section):
    """The wearer. Labels that differ from the names of the model's markers are listed in markers, label = name."""

    mass_kg: Positive
    hand_load_kg: NonNegative = 0.0
    vertical: Literal["x", "y", "z"] = "z"  # the laboratory's vertical axis
    marker_set: str = ""  # its name or file, as for `station scale`; without it the markers of the model
    markers: dict[str, str] = Field(default_factory=dict)
    cord: Cord | None = None


def read_subject(folder: Path) -> Subject:
    """Raises SubjectError that names the key that is missing, unknown or out of range."""
    path = folder / SUBJECT_FILE
    try:
        return Subject.model_validate(parse_toml(read_regular(path, LARGEST_SUIT)))
    except (OSError, PlainDataError) as error:
        raise refuse_subject(SubjectCode.UNREADABLE, path=str(path), reason=describe_failure(error)) from error
    except ValidationError as error:
        raise refuse_subject(SubjectCode.INVALID_KEY, path=str(path), reason=describe_error(error)) from error


def refuse_subject(code: SubjectCode, **figures: float | str) -> SubjectError:
    return SubjectError(Message(code, figures))
