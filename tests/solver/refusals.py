"""Refusals of the solver, by their codes and by the name or figure that their sentence must have."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from solver.errors import SolverCode, SolverError


@contextmanager
def raises_refusal(code: SolverCode, naming: str = "") -> Iterator[pytest.ExceptionInfo[SolverError]]:
    """The block raises a SolverError of this code, in one sentence that has the name or the figure."""
    with pytest.raises(SolverError) as caught:
        yield caught
    assert caught.value.code is code
    assert naming in str(caught.value)
    assert "\n" not in str(caught.value)
