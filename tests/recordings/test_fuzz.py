"""A short run of what benchmarks/fuzz.py does for long."""

from __future__ import annotations

import pytest

from tests.drivers.fuzz import Target, run
from tests.recordings.fuzz import TARGETS


@pytest.mark.parametrize("target", TARGETS, ids=lambda target: target.name)
def test_no_content_of_a_file_causes_a_hang_a_crash_or_a_wrong_number(target: Target) -> None:
    assert run(target, 200) > 0
