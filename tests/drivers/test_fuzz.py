"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest

from tests.drivers.fuzz import TARGETS, Target, run


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_whatever_comes_nothing_hangs_breaks_or_is_believed(target: Target) -> None:
    assert run(target, 50) > 0
