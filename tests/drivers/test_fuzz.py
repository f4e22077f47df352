"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest
from hypothesis import given, settings

from tests.drivers.fuzz import TARGETS, Target


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_whatever_comes_nothing_hangs_breaks_or_is_believed(target: Target) -> None:
    examples = max(10, round(target.share * 100))
    seen = 0

    @settings(max_examples=examples, deadline=None)
    @given(target.examples)
    def run(example: object) -> None:
        nonlocal seen
        seen += 1
        target.holds(example)

    run()
    assert seen >= examples // 2, "the target's examples do come"
