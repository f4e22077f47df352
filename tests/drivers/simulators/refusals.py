"""Assert the code of a refusal of the simulated bench."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from drivers.simulators.errors import SimulatorCode, SimulatorError


@contextmanager
def raises_refusal(code: SimulatorCode, naming: str = "") -> Iterator[None]:
    """The block raises a SimulatorError with this code, in one line that names the wrong key or value."""
    with pytest.raises(SimulatorError) as caught:
        yield
    assert caught.value.code is code
    assert naming in str(caught.value)
    assert "\n" not in str(caught.value)
