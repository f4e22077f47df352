"""Names of people are recognised, so that a session is filed under a code."""

from __future__ import annotations

import pytest

from station.session.plan_check import looks_like_a_name


@pytest.mark.parametrize("word", ["Maria", "smith", "Anna Lee", "de Vries"])
def test_a_name_is_recognised(word: str) -> None:
    assert looks_like_a_name(word)


@pytest.mark.parametrize("word", ["P01", "S12b", "AB", "x3", ""])
def test_a_code_is_not_a_name(word: str) -> None:
    assert not looks_like_a_name(word)
