"""report.json: every number of report.html with its source; its schema, how it is written and read."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

from documents.plain_data import read_json
from documents.validation import refused_as
from recordings.manifest import DataOrigin
from station.errors import StationError
from station.messages.file_messages import NumberCode

FORMAT: Literal[3] = 3
"""It rises where a key changes its meaning or is left out, not where one is added."""


class ReportFileError(StationError):
    """A report.json that cannot be used."""


class Part(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class Derivation(StrEnum):
    """Operation that gives a number from the value at its pointer."""

    VALUE = "value"
    SUM = "sum"
    LENGTH = "length"
    DISTINCT = "distinct"
    """Number of different values at the pointers over the recordings of the number; of recordings without a pointer."""


def pointer_below(pointer: str, key: str | int) -> str:
    """JSON Pointer to an element of the object or list at a pointer."""
    escaped = str(key).replace("~", "~0").replace("/", "~1")
    return f"{pointer}/{escaped}"


class Source(Part):
    """Source of a number: file in the session folder and JSON Pointer (RFC 6901) into it."""

    file: Annotated[str, Field(description="of a recording, the pointer is into its manifest; empty for a count")]
    pointer: str = ""
    derivation: Annotated[
        Derivation, Field(strict=False, description="how the number follows from what the pointer gives")
    ] = Derivation.VALUE

    @classmethod
    def of(cls, file: str, pointer: str = "", derivation: Derivation = Derivation.VALUE) -> Source:
        """Without validation: a result has a place for each of its numbers."""
        return cls.model_construct(file=file, pointer=pointer, derivation=derivation)

    def child(self, key: str | int) -> Source:
        """Place of an element of the object or list at this place."""
        return Source.of(self.file, pointer_below(self.pointer, key))

    def derived(self, derivation: Derivation) -> Source:
        """The same place with another derivation."""
        return Source.of(self.file, self.pointer, derivation)

    @property
    def keys(self) -> list[str]:
        """The pointer as keys."""
        return [key.replace("~1", "/").replace("~0", "~") for key in self.pointer.split("/")[1:]]

    def resolve(self, document: Any) -> Any:
        """The value at this place of a document. Raises KeyError if there is none."""
        value = document
        for key in self.keys:
            try:
                value = value[int(key) if isinstance(value, list) else key]
            except (LookupError, TypeError, ValueError):
                raise KeyError(self.pointer) from None
        return value


class ReportedNumber(Part):
    """A number of the page, whose element has the key of this entry as its id. A sentence with numbers is one, too."""

    text: str
    value: float | str | list[float]
    ci95: Annotated[list[float] | None, Field(min_length=2, max_length=2)] = None
    unit: Annotated[str, Field(description="of value; the text may show another")] = ""
    source: Source
    recordings: Annotated[list[str], Field(default_factory=list, description="files on whose samples it rests")]
    draws: Annotated[int | None, Field(description="random draws behind ci95")] = None
    seed: int | None = None

    @property
    def mark(self) -> tuple[str, str | None]:
        """Text and attribute `value` of its element; a sentence has no attribute."""
        values = self.value if isinstance(self.value, list) else [self.value]
        return self.text, None if isinstance(self.value, str) else " ".join(map(repr, values))


class DrawnFigure(Part):
    """A figure of the page: its caption, the SHA-256 of its drawing, and the places of the series that it shows."""

    caption: str
    sha256: str
    sources: list[Source]
    recordings: list[str] = Field(default_factory=list)

    @property
    def mark(self) -> tuple[str, str]:
        return self.caption, self.sha256


class ReportDocument(Part):
    """report.json: every number of report.html with its source. Values are SI; the key of a pointer has the unit."""

    format: Literal[3]
    page: Annotated[str, Field(description="file")]
    origin: Annotated[DataOrigin, Field(strict=False)]
    version: Annotated[str, Field(description="of the station that wrote the page")]
    inputs: Annotated[list[str], Field(description="files that the page is made of")]
    numbers: Annotated[dict[str, ReportedNumber], Field(description="by the id of the element on the page")]
    figures: Annotated[dict[str, DrawnFigure], Field(description="by the id of the element on the page")]


def numbers_text(document: ReportDocument) -> str:
    """The document as the text of report.json. The same page gives the same bytes."""
    plain = document.model_dump(mode="json", exclude_defaults=True)
    return json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read_numbers(path: Path) -> ReportDocument:
    """Read report.json. Raises ReportFileError with the wrong key."""
    with refused_as(ReportFileError, path, NumberCode.FILE):
        return ReportDocument.model_validate(read_json(path))
