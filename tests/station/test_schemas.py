"""The published JSON Schemas are those by which the station writes and reads."""

from docs.reference.schemas import SCHEMAS, schema_texts


def test_the_published_schemas_are_those_in_use() -> None:
    published = {path.name: path.read_text(encoding="utf-8") for path in SCHEMAS.iterdir()}
    assert published == schema_texts(), "publish them anew: python -m docs.reference.schemas"
