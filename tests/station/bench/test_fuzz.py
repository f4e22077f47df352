"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest

from tests.drivers.fuzz import Target, run
from tests.station.fuzz import TARGETS


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_any_configuration_is_used_or_refused_with_a_sentence(target: Target) -> None:
    assert run(target, 200) > 0
