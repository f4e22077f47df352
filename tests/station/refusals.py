"""Expect a refusal by its code, not by its sentence."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from enum import StrEnum

import pytest

from station.errors import StationError


@contextmanager
def raises_refusal(kind: type[StationError], code: StrEnum) -> Iterator[pytest.ExceptionInfo[StationError]]:
    """The block must raise this kind of error with this code."""
    with pytest.raises(kind) as caught:
        yield caught
    assert caught.value.code == code
