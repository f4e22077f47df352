"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest

from tests.drivers.fuzz import Target, run
from tests.recordings.fuzz import TARGETS


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_whatever_the_file_holds_nothing_hangs_breaks_or_is_believed(target: Target) -> None:
    assert run(target, 200) > 0
