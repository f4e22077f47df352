"""Messages on subject.toml and the recordings beside it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import StrEnum


class SubjectCode(StrEnum):
    """What is wrong with subject.toml, or missing in its folder."""

    UNREADABLE = "subject.unreadable"
    INVALID_KEY = "subject.invalid_key"
    NO_MASS = "subject.no_mass"
    UNKNOWN_MARKERS = "subject.unknown_markers"
    NO_MOTION = "subject.no_motion"
    UNKNOWN_CUFF = "subject.unknown_cuff"


SUBJECT: Mapping[StrEnum, str] = {
    SubjectCode.UNREADABLE: (
        "{path} should describe the wearer, mass_kg at least, and cannot be read ({reason}); write it"
    ),
    SubjectCode.INVALID_KEY: "{path}: {reason}; correct it",
    SubjectCode.NO_MASS: (
        "the body mass of the wearer is not known, and the masses of the arm follow from it; enter it in the session's "
        "set-up, or as mass_kg in subject.toml"
    ),
    SubjectCode.UNKNOWN_MARKERS: (
        "subject.toml names the markers {markers}, which {model} does not have; it has {known}"
    ),
    SubjectCode.NO_MOTION: (
        "{folder} should hold a motion trial of the wearer and holds none, but {poses:.0f} pose trials; record "
        "one with `station record --test motion`"
    ),
    SubjectCode.UNKNOWN_CUFF: (
        "subject.toml names the cuff {cuff} in the cord, and the cuffs file holds {known}; fit it or correct the name"
    ),
}
