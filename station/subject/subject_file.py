"""subject.toml, beside the recordings of a session: what no marker shows of the wearer."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal

from pydantic import Field

from documents.message import Message
from documents.plain_data import parse_toml
from documents.regular_file import LARGEST_SUIT, read_regular
from documents.validation import NonNegative, Positive, Section, refused_as
from station.checksums import write_whole
from station.errors import StationError
from station.messages.kinematics_messages import SubjectCode

SUBJECT_FILE = "subject.toml"
BARE_KEY = re.compile(r"[A-Za-z0-9_-]+")


class SubjectError(StationError):
    """A folder from which no person can be assessed; one sentence."""


class Cord(Section):
    """The cord in the trials in which it was tight: its rest length, and the arm cuff that was worn."""

    rest_length_m: Positive | None = None
    cuff: str | None = None


class Subject(Section):
    """The wearer. Labels that differ from the names of the model's markers are listed in markers, label = name.

    Without mass_kg the wearer cannot be assessed; the laboratory's axis and markers are known all the same.
    """

    mass_kg: Positive | None = None
    hand_load_kg: NonNegative = 0.0
    vertical: Literal["x", "y", "z"] = "z"  # the laboratory's vertical axis
    marker_set: str = ""  # its name or file, as for `station scale`; without it the markers of the model
    markers: dict[str, str] = Field(default_factory=dict)
    cord: Cord | None = None


def read_subject(folder: Path) -> Subject:
    """Raises SubjectError that names the key that is missing, unknown or out of range."""
    path = folder / SUBJECT_FILE
    with refused_as(SubjectError, path, SubjectCode.UNREADABLE, SubjectCode.INVALID_KEY):
        return Subject.model_validate(parse_toml(read_regular(path, LARGEST_SUIT)))


def write_subject(folder: Path, subject: Subject) -> None:
    """Replace subject.toml; what is not known is left out."""
    known = {name: value for name, value in subject.model_dump(exclude_none=True).items() if value not in ("", {})}
    tables = {name: value for name, value in known.items() if isinstance(value, Mapping)}
    keys = _key_lines({name: value for name, value in known.items() if name not in tables})
    write_whole(folder / SUBJECT_FILE, keys + "".join(f"\n[{name}]\n{_key_lines(tables[name])}" for name in tables))


def _key_lines(table: Mapping[str, Any]) -> str:
    return "".join(f"{key if BARE_KEY.fullmatch(key) else _text(key)} = {_text(table[key])}\n" for key in table)


def _text(value: float | str) -> str:
    """A number or text as TOML, which escapes texts as JSON does and one character more."""
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def refuse_subject(code: SubjectCode, **figures: float | str) -> SubjectError:
    return SubjectError(Message(code, figures))
