"""protocol.toml in a session's folder: the operator's corrections of the detected steps.

step_masses_kg = [1.53, 1.53, 1.0]          # the weights as they were, instead of the configuration's

[steps_s]                                    # when the load changed, seconds after the sync edge
"cuff-hand_test-static_run-1.mcap" = [3.1, 12.0, 20.9]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Annotated

from pydantic import AfterValidator, Field, ValidationError

from documents.plain_data import PlainDataError, read_toml, shortened
from documents.validation import Number, Positive, Section, describe_error, faulty_key
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode

PROTOCOL_FILE = "protocol.toml"
REPLACEMENTS = (".recovered.mcap", ".completed.mcap")
"""Endings of the files that replace a recording; the steps of the recording apply to them."""


class ProtocolFileError(CodedError):
    """The session's protocol.toml cannot be used."""


@dataclass(frozen=True)
class SessionProtocol:
    """step_masses [kg], None: as configured; steps: file name of a recording → times [s] of its steps."""

    step_masses: tuple[float, ...] | None = None
    steps: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def read_protocol(folder: Path) -> SessionProtocol:
    """Read protocol.toml of a session; an empty SessionProtocol without the file. Raises ProtocolFileError."""
    path = folder / PROTOCOL_FILE
    try:
        data = read_toml(path)
    except FileNotFoundError:
        return SessionProtocol()
    except OSError as error:
        figures = {"file": str(path), "problem": error.strerror or str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_UNREADABLE, figures) from error
    except PlainDataError as error:
        figures = {"file": str(path), "problem": str(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_NOT_TOML, figures) from error
    try:
        table = _ProtocolTable.model_validate(data)
    except ValidationError as error:
        figures = {"file": str(path), "key": faulty_key(error), "problem": describe_error(error)}
        raise ProtocolFileError(FitErrorCode.PROTOCOL_INVALID, figures) from error
    return SessionProtocol(table.step_masses_kg, _with_replacements(table.steps_s, path))


def _with_replacements(steps: Mapping[str, tuple[float, ...]], path: Path) -> dict[str, tuple[float, ...]]:
    """Steps by recording, and by the file that replaces it. Refuse a name without a file: it would have no effect."""
    for file in steps:
        if not (path.parent / file).is_file():
            figures = {"file": str(path), "recording": file}
            raise ProtocolFileError(FitErrorCode.PROTOCOL_NO_RECORDING, figures)
    return {Path(file).stem + ending: times for file, times in steps.items() for ending in REPLACEMENTS} | dict(steps)


def _rising(times: tuple[float, ...]) -> tuple[float, ...]:
    if any(after <= before for before, after in pairwise(times)):
        raise ValueError(f"found {shortened(list(times))}, expected times that rise")
    return times


class _ProtocolTable(Section):
    """The keys of protocol.toml."""

    step_masses_kg: tuple[Positive, ...] | None = None
    steps_s: dict[str, Annotated[tuple[Number, ...], AfterValidator(_rising)]] = Field(default_factory=dict)
