"""JSON Schemas of the files that the station writes; `python -m station.schemas docs/schemas` publishes them."""

from __future__ import annotations

import json
import sys
from pathlib import Path

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

SCHEMAS: dict[str, TypeAdapter[object]] = {
    "cuffs.schema.json": TypeAdapter(CuffsDocument),
    "assessment.schema.json": TypeAdapter(AssessmentDocument),
    "session.schema.json": TypeAdapter(JournalLine),
    "body.schema.json": TypeAdapter(BodyDocument),
    "ik.schema.json": TypeAdapter(IkDocument),
    "emg.schema.json": TypeAdapter(EmgDocument),
    "study.schema.json": TypeAdapter(StudyDocument),
    "plan.schema.json": TypeAdapter(StudyPlanDocument),
    "normative.schema.json": TypeAdapter(NormativeDocument),
    "report.schema.json": TypeAdapter(ReportDocument),
}
"""Published file → the type that writes and reads the document, or one line of it."""


def schema_text(name: str) -> str:
    """The schema (JSON Schema 2020-12) of this file name."""
    schema = SCHEMAS[name].json_schema()
    return json.dumps({"$schema": "https://json-schema.org/draft/2020-12/schema", **schema}, indent=1) + "\n"


if __name__ == "__main__":
    for name in SCHEMAS:
        (Path(sys.argv[1]) / name).write_text(schema_text(name), encoding="utf-8")
