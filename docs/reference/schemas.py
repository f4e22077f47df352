"""The page on the files that the station writes: every JSON Schema of docs/schemas as tables. A hook of mkdocs.

`python -m docs.reference.schemas` writes docs/schemas from the types of the station.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

SCHEMAS = Path(__file__).parents[1] / "schemas"


def file_schemas() -> str:
    """A section for each schema, a table for each kind of object in it."""
    page = ["# Files of the station", ""]
    page += ["Each file states its format as a number. Files of every past format are read.", ""]
    for path in sorted(SCHEMAS.glob("*.json")):
        schema = json.loads(path.read_text(encoding="utf-8"))
        suffix = "jsonl" if "oneOf" in schema else "json"
        page += [f"## {path.name.removesuffix('.schema.json')}.{suffix}", ""]
        page += [f"{schema.get('description', '')} [JSON Schema](../schemas/{path.name})".strip(), ""]
        page += [f"One line is a {_type(schema)}.", ""] if "oneOf" in schema else _fields(schema)
        for name, part in sorted(schema.get("$defs", {}).items()):
            if "properties" in part:
                page += [f"### {name}", "", _meaning(part), "", *_fields(part)]
            elif "enum" in part:
                page += [f"### {name}", "", ", ".join(f"`{value}`" for value in part["enum"]), ""]
    return "\n".join(page)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the written page."""
    from mkdocs.structure.files import File

    files.append(File.generated(config, "reference/files.md", content=file_schemas()))
    return files


def _fields(part: dict[str, Any]) -> list[str]:
    needed = part.get("required", [])
    rows = [
        f"| `{name}` | {_type(field)} | {'yes' if name in needed else ''} | {_meaning(field)} |"
        for name, field in part.get("properties", {}).items()
    ]
    return ["| key | type | required | meaning |", "|---|---|---|---|", *rows, ""]


def _meaning(field: dict[str, Any]) -> str:
    return " ".join(str(field.get("description", "")).split()).replace("|", "\\|")


def _type(field: dict[str, Any]) -> str:
    if "$ref" in field:
        name = field["$ref"].rpartition("/")[2]
        return f"[{name}](#{name.lower()})"
    if "const" in field:
        return f"`{field['const']}`"
    if "enum" in field:
        return " or ".join(f"`{value}`" for value in field["enum"])
    for several in ("anyOf", "oneOf"):
        if several in field:
            return " or ".join(_type(choice) for choice in field[several])
    return _container(field)


def _container(field: dict[str, Any]) -> str:
    kind = str(field.get("type", "any"))
    inner = field.get("items" if kind == "array" else "additionalProperties")
    shown = "list" if kind == "array" else kind
    return f"{shown} of {_type(inner)}" if isinstance(inner, dict) else shown


def schema_texts() -> dict[str, str]:
    """File of docs/schemas → JSON Schema 2020-12 of the type that writes and reads the document, or one line of it."""
    from pydantic import TypeAdapter

    from fitting.results.cuffs_schema import CuffsDocument
    from station.assessment.assessment_file import AssessmentDocument
    from station.emg.emg_json import EmgDocument
    from station.journal import JournalLine
    from station.kinematics.ik import IkDocument
    from station.kinematics.person import BodyDocument
    from station.report.report_file import ReportDocument
    from station.study.designs import StudyPlanDocument
    from station.study.study_document import NormativeDocument, StudyDocument

    documents: dict[str, TypeAdapter[object]] = {
        "cuffs": TypeAdapter(CuffsDocument),
        "assessment": TypeAdapter(AssessmentDocument),
        "session": TypeAdapter(JournalLine),
        "body": TypeAdapter(BodyDocument),
        "ik": TypeAdapter(IkDocument),
        "emg": TypeAdapter(EmgDocument),
        "study": TypeAdapter(StudyDocument),
        "plan": TypeAdapter(StudyPlanDocument),
        "normative": TypeAdapter(NormativeDocument),
        "report": TypeAdapter(ReportDocument),
    }
    dialect = {"$schema": "https://json-schema.org/draft/2020-12/schema"}
    schemas = {name: dialect | document.json_schema() for name, document in documents.items()}
    return {f"{name}.schema.json": json.dumps(schema, indent=1) + "\n" for name, schema in schemas.items()}


if __name__ == "__main__":
    for file, text in schema_texts().items():
        (SCHEMAS / file).write_text(text, encoding="utf-8")
