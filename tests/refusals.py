"""Expect an error by its code and its figures, not by its sentence."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from enum import StrEnum

import pytest

from documents.message import Figures
from drivers.simulators.errors import SimulatorCode, SimulatorError
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TensorCode, TrialNoteCode
from recordings.errors import RecordingCode, RecordingError
from solver.errors import SolverCode, SolverError
from station.errors import StationError

_ROOTS: dict[type[StrEnum], type[Exception]] = {
    SimulatorCode: SimulatorError,
    RecordingCode: RecordingError,
    SolverCode: SolverError,
    RejectionCode: CodedError,
    TensorCode: CodedError,
    FitErrorCode: CodedError,
}
"""Codes → class of the errors that carry them; the station's have a class for each of their enumerations."""


@contextmanager
def raises_refusal(
    code: StrEnum, naming: str = "", *, kind: type[StationError] | None = None, **figures: object
) -> Iterator[pytest.ExceptionInfo[Exception]]:
    """The block raises an error of this code and kind with these figures, in one line that names what is at fault."""
    with pytest.raises(kind or _ROOTS[type(code)]) as caught:
        yield caught
    error = caught.value
    assert error.code == code  # type: ignore[attr-defined]
    assert naming in str(error)
    assert "\n" not in str(error)
    if figures:
        found = error.cause if isinstance(error, StationError) else error.reason  # type: ignore[attr-defined]
        assert {name: found.figures[name] for name in figures} == figures  # type: ignore[union-attr]


def figures_by_code(notes: Iterable[Note]) -> dict[TrialNoteCode, Figures]:
    """Code → figures of the notes on a trial."""
    return {note.code: note.figures for note in notes}  # type: ignore[misc]
