"""Assert the code of an error of a recording."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from recordings.errors import RecordingCode, RecordingError


@contextmanager
def raises_refusal(code: RecordingCode, naming: str = "") -> Iterator[None]:
    """The block raises a RecordingError with this code, whose sentence names the file, line or label at fault."""
    with pytest.raises(RecordingError) as caught:
        yield
    assert caught.value.code is code
    assert naming in str(caught.value)
