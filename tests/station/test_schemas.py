"""The published JSON Schemas are those by which the station writes and reads."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.schemas import SCHEMAS, schema_text

PUBLISHED = Path(__file__).parents[2] / "docs" / "schemas"


@pytest.mark.parametrize("name", SCHEMAS)
def test_the_published_schema_is_the_one_in_use(name: str) -> None:
    published = (PUBLISHED / name).read_text(encoding="utf-8")
    assert published == schema_text(name), "publish it anew: python -m station.schemas docs/schemas"


def test_every_published_schema_is_of_a_file_of_the_station() -> None:
    assert {path.name for path in PUBLISHED.iterdir()} == set(SCHEMAS)
