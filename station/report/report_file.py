"""report.json: every number of report.html with its source; its schema, how it is written and read."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from documents.plain_data import PlainDataError, read_json
from documents.validation import describe_error
from recordings.manifest import DataOrigin
from station.errors import StationError
from station.messages.file_codes import NumberCode
from station.messages.message import Message
from station.report.located import Derivation, Source
from station.report.sourced_number import Form, Rendering, SourcedNumber

FORMAT: Literal[1] = 1
"""It rises where a key changes its meaning, not where one is added."""


class ReportFileError(StationError):
    """A report.json that cannot be used."""


class _Entry(BaseModel):
    model_config = ConfigDict(strict=True, frozen=True, allow_inf_nan=False)


class SourceEntry(_Entry):
    """Where a number is from: file in the session folder and JSON Pointer (RFC 6901) into it."""

    file: Annotated[str, Field(description="of a recording, the pointer is into its manifest; empty for a count")]
    pointer: str = ""
    derivation: Annotated[
        Derivation,
        Field(strict=False, description="how the number follows from what the pointer gives"),
    ] = Derivation.VALUE

    def source(self) -> Source:
        return Source(self.file, self.pointer, self.derivation)


class RenderingEntry(_Entry):
    """Rule of the text: it shows scale × value; around has what surrounds the number, in place of its braces."""

    form: Annotated[Form, Field(strict=False)]
    scale: float = 1.0
    digits: Annotated[int, Field(description="decimals, where the interval does not determine them")] = 0
    around: str = "{}"


class ReportedNumberEntry(_Entry):
    """A number of the page, whose element has the key of this entry as its id. A sentence with numbers is one, too."""

    text: str
    value: float | str | list[float]
    ci95: Annotated[list[float] | None, Field(min_length=2, max_length=2)] = None
    censored: Annotated[str | None, Field(description="end of ci95 that is a bound: low, high or both")] = None
    unit: Annotated[str, Field(description="of value; the text shows scale × value")] = ""
    rendering: RenderingEntry
    source: SourceEntry
    figures: Annotated[
        dict[str, float | str], Field(default_factory=dict, description="of a sentence, by name with the unit")
    ]
    recordings: Annotated[list[str], Field(default_factory=list, description="files on whose samples it rests")]
    draws: Annotated[int | None, Field(description="random draws behind ci95")] = None
    seed: int | None = None

    def number(self) -> SourcedNumber:
        """The number as it is rendered."""
        rendering = self.rendering
        return SourcedNumber(
            tuple(self.value) if isinstance(self.value, list) else self.value,
            self.source.source(),
            Rendering(rendering.form, rendering.scale, rendering.digits, rendering.around),
            (self.ci95[0], self.ci95[1]) if self.ci95 else None,
            self.censored,
            tuple(self.recordings),
        )


class DrawnFigureEntry(_Entry):
    """A figure of the page: its caption, the SHA-256 of its drawing, and the places of the series that it shows."""

    caption: str
    sha256: str
    sources: list[SourceEntry]
    recordings: list[str] = Field(default_factory=list)


class PageEntry(_Entry):
    file: str
    sha256: str


class ReportDocument(_Entry):
    """report.json: every number of report.html with its source. Values are SI; the key of a pointer has the unit."""

    format: Literal[1]
    page: PageEntry
    origin: Annotated[DataOrigin, Field(strict=False)]
    version: Annotated[str, Field(description="of the station that wrote the page")]
    inputs: Annotated[dict[str, str], Field(description="file → SHA-256 of all that the page is made of")]
    numbers: Annotated[dict[str, ReportedNumberEntry], Field(description="by the id of the element on the page")]
    figures: Annotated[dict[str, DrawnFigureEntry], Field(description="by the id of the element on the page")]


def numbers_text(document: ReportDocument) -> str:
    """The document as the text of report.json. The same page gives the same bytes."""
    plain = document.model_dump(mode="json", exclude_defaults=True)
    return json.dumps(plain, indent=1, ensure_ascii=False, allow_nan=False) + "\n"


def read_numbers(path: Path) -> ReportDocument:
    """Read report.json. Raises ReportFileError with the wrong key."""
    try:
        return ReportDocument.model_validate(read_json(path))
    except OSError as error:
        reason = str(error.strerror or error)
    except PlainDataError as error:
        reason = str(error)
    except ValidationError as error:
        reason = describe_error(error)
    raise ReportFileError(Message(NumberCode.FILE, {"file": str(path), "reason": reason}))
