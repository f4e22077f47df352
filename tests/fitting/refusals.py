"""Assert the code and the figures of an error."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import contextmanager

import pytest

from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode, RejectionCode, TensorCode, TrialNoteCode
from fitting.results.rendering import Figures, Note


@contextmanager
def raises_refusal(code: RejectionCode | TensorCode | FitErrorCode, **figures: object) -> Iterator[None]:
    """The block raises an error with this code and these figures."""
    with pytest.raises(CodedError) as caught:
        yield
    reason = caught.value.reason
    assert reason.code is code
    assert {name: reason.figures[name] for name in figures} == figures


def figures_by_code(notes: Iterable[Note]) -> dict[TrialNoteCode, Figures]:
    """Code → figures of the notes on a trial."""
    return {note.code: note.figures for note in notes}  # type: ignore[misc]
