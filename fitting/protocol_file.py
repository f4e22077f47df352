"""protocol.toml in a session's folder: where the operator knows better than the step detector.

step_masses_kg = [1.53, 1.53, 1.0]          # the weights as they were, instead of the configuration's

[steps_s]                                    # when the load changed, seconds after the sync edge
"cuff-hand_test-static_run-1.mcap" = [3.1, 12.0, 20.9]
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_toml, shortened

PROTOCOL_FILE = "protocol.toml"
BETTER = (".recovered.mcap", ".completed.mcap")
"""Endings of the files that stand for a recording: its steps are theirs."""


class ProtocolFileError(Exception):
    """The session's protocol.toml cannot be used; one sentence says where and what was expected."""


@dataclass(frozen=True)
class SessionProtocol:
    """step_masses [kg], None: as configured; steps: file name of a recording → times of its steps [s]."""

    step_masses: tuple[float, ...] | None = None
    steps: Mapping[str, tuple[float, ...]] = field(default_factory=dict)


def read_protocol(folder: Path) -> SessionProtocol:
    """What protocol.toml says; nothing where there is none. Raises ProtocolFileError."""
    path = folder / PROTOCOL_FILE
    try:
        data = read_toml(path)
    except FileNotFoundError:
        return SessionProtocol()
    except OSError as error:
        raise ProtocolFileError(f"{path} cannot be read: {error.strerror or error}") from error
    except PlainDataError as error:
        raise ProtocolFileError(f"{path} {error}") from error
    unknown = data.keys() - {"step_masses_kg", "steps_s"}
    if unknown or not isinstance(data.get("steps_s", {}), dict):
        found = ", ".join(sorted(unknown)) or "no table steps_s"
        raise ProtocolFileError(f"{path} has {found}, expected step_masses_kg and a table steps_s of file = [times]")
    masses = data.get("step_masses_kg")
    return SessionProtocol(
        None if masses is None else _positive(masses, f"{path}: step_masses_kg"),
        _steps(data.get("steps_s", {}), path),
    )


def _steps(table: Mapping[str, Any], path: Path) -> dict[str, tuple[float, ...]]:
    """By file, and by the file that stands for it. A wrong name would leave the correction without effect: refused."""
    steps = {file: _rising(times, f'{path}: steps_s."{file}"') for file, times in table.items()}
    for file in steps:
        if not (path.parent / file).is_file():
            raise ProtocolFileError(f"{path}: steps_s names {file}, expected a recording beside it; correct the name")
    return {Path(file).stem + ending: times for file, times in steps.items() for ending in BETTER} | steps


def _positive(entry: Any, where: str) -> tuple[float, ...]:
    numbers = _numbers(entry, where)
    if min(numbers, default=1.0) <= 0:
        raise ProtocolFileError(f"{where} is {shortened(entry)}, expected weights above 0 kg")
    return numbers


def _rising(entry: Any, where: str) -> tuple[float, ...]:
    numbers = _numbers(entry, where)
    if any(after <= before for before, after in pairwise(numbers)):
        raise ProtocolFileError(f"{where} is {shortened(entry)}, expected times that rise")
    return numbers


def _numbers(entry: Any, where: str) -> tuple[float, ...]:
    if not isinstance(entry, list) or not all(type(each) in (int, float) and math.isfinite(each) for each in entry):
        raise ProtocolFileError(f"{where} is {shortened(entry)}, expected a list of finite numbers")
    return tuple(float(each) for each in entry)
