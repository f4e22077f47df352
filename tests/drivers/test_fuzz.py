"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest

from tests.drivers.fuzz import TARGETS, Target, run


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_no_input_causes_a_hang_a_crash_or_a_wrong_number(target: Target) -> None:
    assert run(target, 50) > 0
