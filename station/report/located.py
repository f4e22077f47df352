"""Values of a JSON document with their place in it, so that a number of the report can be traced to its file.

`located` copies plain data. The copies behave as the values they replace; booleans and null are not replaced. A number
that is computed from a located one is a plain number again.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from typing import Any, TypeVar


class Derivation(StrEnum):
    """How a number is computed from the value at its pointer."""

    VALUE = "value"
    SUM = "sum"
    LENGTH = "length"
    DISTINCT = "distinct"
    """Number of different values at the pointer over the recordings of the number; of recordings without a pointer."""


@dataclass(frozen=True)
class Source:
    """Place of a value: the name of a file in the session folder, and a JSON Pointer (RFC 6901) into it.

    Of a recording, the pointer is into its manifest. file is empty for a count over recordings.
    """

    file: str
    pointer: str = ""
    derivation: Derivation = Derivation.VALUE

    def child(self, key: str | int) -> Source:
        """Place of an element of the object or list at this place."""
        escaped = str(key).replace("~", "~0").replace("/", "~1")
        return Source(self.file, f"{self.pointer}/{escaped}")

    @property
    def keys(self) -> list[str]:
        """The pointer as keys."""
        return [key.replace("~1", "/").replace("~0", "~") for key in self.pointer.split("/")[1:]]


class LocatedObject(dict[str, Any]):
    """A JSON object of a known place."""

    source: Source


class LocatedList(list[Any]):
    """A JSON array of a known place."""

    source: Source


class LocatedText(str):
    """A JSON string of a known place."""

    source: Source


class LocatedFloat(float):
    """A JSON number of a known place."""

    source: Source


class LocatedInteger(int):
    """A JSON integer of a known place."""

    source: Source


Located = TypeVar("Located", LocatedObject, LocatedList, LocatedText, LocatedFloat, LocatedInteger)


def located(value: Any, source: Source) -> Any:
    """A copy of plain data, every object, array, string and number with its place; source is that of the whole."""
    if isinstance(value, Mapping):
        elements = {key: located(element, source.child(key)) for key, element in value.items()}
        return _at(LocatedObject(elements), source)
    if isinstance(value, list | tuple):
        entries = [located(element, source.child(index)) for index, element in enumerate(value)]
        return _at(LocatedList(entries), source)
    if isinstance(value, str):
        return _at(LocatedText(value), source)
    if isinstance(value, float):
        return _at(LocatedFloat(value), source)
    if isinstance(value, int) and not isinstance(value, bool):
        return _at(LocatedInteger(value), source)
    return value


def resolve(document: Any, source: Source) -> Any:
    """The value at a place of a document. Raises KeyError if there is none."""
    value = document
    for key in source.keys:
        if isinstance(value, Mapping) and key in value:
            value = value[key]
        elif isinstance(value, list) and key.isdecimal() and int(key) < len(value):
            value = value[int(key)]
        else:
            raise KeyError(source.pointer)
    return value


def _at(value: Located, source: Source) -> Located:
    value.source = source
    return value
