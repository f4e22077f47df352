"""The JSON Schemas of the files that the station writes: `python -m station.schemas docs/schemas` publishes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

from pydantic import TypeAdapter

from fitting.results.cuffs_schema import CuffsDocument
from station.assessment.assessment_file import AssessmentDocument

SCHEMAS: dict[str, TypeAdapter[object]] = {
    "cuffs.schema.json": TypeAdapter(CuffsDocument),
    "assessment.schema.json": TypeAdapter(AssessmentDocument),
}
"""Published file → the type that writes and reads the document."""


def schema_text(name: str) -> str:
    """The schema (JSON Schema 2020-12) that is published under this name."""
    schema = SCHEMAS[name].json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=1) + "\n"


if __name__ == "__main__":
    for name in SCHEMAS:
        (Path(sys.argv[1]) / name).write_text(schema_text(name), encoding="utf-8")
