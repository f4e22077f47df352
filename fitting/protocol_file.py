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
from documents.validation import Number, Positive, Section, describe_error
from fitting.errors import FitError

PROTOCOL_FILE = "protocol.toml"
BETTER = (".recovered.mcap", ".completed.mcap")
"""Endings of the files that replace a recording; the steps of the recording hold for them."""


class ProtocolFileError(FitError):
    """The session's protocol.toml cannot be used; one sentence says where and what was expected."""


@dataclass(frozen=True)
class SessionProtocol:
    """step_masses [kg], None: as configured; steps: file name of a recording → times of its steps [s]."""

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
        raise ProtocolFileError(f"{path} cannot be read: {error.strerror or error}") from error
    except PlainDataError as error:
        raise ProtocolFileError(f"{path} {error}") from error
    try:
        table = _ProtocolTable.model_validate(data)
    except ValidationError as error:
        raise ProtocolFileError(f"{path}: {describe_error(error)}") from error
    return SessionProtocol(table.step_masses_kg, _with_replacements(table.steps_s, path))


def _with_replacements(steps: Mapping[str, tuple[float, ...]], path: Path) -> dict[str, tuple[float, ...]]:
    """Steps by recording, and by the file that replaces it. A name without a file would have no effect: refused."""
    for file in steps:
        if not (path.parent / file).is_file():
            raise ProtocolFileError(f"{path}: steps_s names {file}, expected a recording beside it; correct the name")
    return {Path(file).stem + ending: times for file, times in steps.items() for ending in BETTER} | dict(steps)


def _rising(times: tuple[float, ...]) -> tuple[float, ...]:
    if any(after <= before for before, after in pairwise(times)):
        raise ValueError(f"found {shortened(list(times))}, expected times that rise")
    return times


class _ProtocolTable(Section):
    """The keys of protocol.toml."""

    step_masses_kg: tuple[Positive, ...] | None = None
    steps_s: dict[str, Annotated[tuple[Number, ...], AfterValidator(_rising)]] = Field(default_factory=dict)
