"""normative.json: what volunteers of a study had, for comparison with the value of a later session."""

from __future__ import annotations

import json
from enum import StrEnum
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from documents.plain_data import PlainDataError, read_json
from documents.regular_file import describe_failure
from documents.validation import describe_error
from recordings.manifest import DataOrigin
from station.checksums import sha256_of, write_checksums
from station.messages.message import Message
from station.messages.study_messages import StudyCode
from station.study.sessions import StudyError
from station.study.study_document import QuantityName, StudyDocument
from station.whole_file import write_whole

NORMATIVE_FILE = "normative.json"
FORMAT: Literal[1] = 1


class NormativePlace(StrEnum):
    """Where a value is in relation to the 95 % prediction interval."""

    BELOW = "below"
    WITHIN = "within"
    ABOVE = "above"


class _Entry(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class NormativeEntry(_Entry):
    """Mean over volunteers, and 95 % prediction interval of a new volunteer in one donning of `repeats` repeats, SI."""

    mean: float
    mean_ci95: tuple[float, float]
    prediction95: tuple[float, float]
    volunteers: int = Field(ge=2)
    repeats: int = Field(ge=1)

    def place(self, value: float) -> NormativePlace:
        """Where the value of a donning is."""
        low, high = self.prediction95
        if value < low:
            return NormativePlace.BELOW
        return NormativePlace.ABOVE if value > high else NormativePlace.WITHIN


class NormativeDocument(_Entry):
    """normative.json: cuff → quantity → mean and 95 % prediction interval; study_sha256 is the hash of study.json."""

    format: Literal[1]
    origin: DataOrigin
    study_sha256: str
    cuffs: dict[str, dict[QuantityName, NormativeEntry]]


def write_normative(study: Path, document: StudyDocument) -> Path:
    """Write the table beside study.json; only quantities with a prediction are in it."""
    table: dict[str, dict[QuantityName, NormativeEntry]] = {}
    for cuff, quantities in document.cuffs.items():
        for quantity, found in quantities.items():
            if found.mean is not None and found.prediction is not None:
                table.setdefault(cuff, {})[quantity] = NormativeEntry(
                    mean=found.mean.value,
                    mean_ci95=found.mean.ci95,
                    prediction95=found.prediction.ci95,
                    volunteers=len(found.volunteers),
                    repeats=found.repeats,
                )
    normative = NormativeDocument(format=FORMAT, origin=document.origin, study_sha256=sha256_of(study), cuffs=table)
    path = study.with_name(NORMATIVE_FILE)
    write_whole(path, json.dumps(normative.model_dump(mode="json"), indent=1, allow_nan=False) + "\n")
    write_checksums(path)
    return path


def read_normative(path: Path) -> NormativeDocument:
    """Raises StudyError for what `station study` would not write."""
    try:
        return NormativeDocument.model_validate(read_json(path))
    except (OSError, PlainDataError) as error:
        raise _wrong_file(path, describe_failure(error)) from error
    except ValidationError as error:
        raise _wrong_file(path, describe_error(error)) from error


def _wrong_file(path: Path, reason: str) -> StudyError:
    return StudyError(Message(StudyCode.WRONG_NORMATIVE, {"path": str(path), "reason": reason}))
