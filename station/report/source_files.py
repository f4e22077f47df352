"""The files that the numbers of a report are from, as plain data."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_json
from fitting.cuffs.cuffs_file import CUFFS_FILE
from recordings.errors import RecordingError
from recordings.manifest import manifest_to_json
from recordings.reader import read_manifest
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.report.located import Derivation, Source, resolve
from station.report.provenance import Provenance
from station.report.session_facts import distinct
from station.report.sourced_number import reduced


class SourceFiles:
    """The results and recordings of a session folder; every file is read once. A recording gives its manifest."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.document = cache(self._document)

    @property
    def provenance(self) -> Provenance:
        return Provenance(self.document(CUFFS_FILE), self.document(ASSESSMENT_FILE))

    def value(self, source: Source, recordings: tuple[str, ...] = ()) -> Any:
        """What a source gives. Raises KeyError if there is nothing, TypeError if it is of another kind."""
        if source.derivation is Derivation.DISTINCT:
            manifests = [self.document(file) for file in recordings]
            if None in manifests:
                raise KeyError(recordings[manifests.index(None)])
            return distinct(manifests, source) if source.pointer else len(manifests)
        return reduced(resolve(self.document(source.file), source), source.derivation)

    def _document(self, file: str) -> Any:
        """None for a file that is missing or cannot be read."""
        path = self.folder / file
        if path.name != file or not path.is_file():
            return None
        try:
            if path.suffix == ".mcap":
                return json.loads(manifest_to_json(read_manifest(path)))
            return read_assessment(path) if file == ASSESSMENT_FILE else read_json(path)
        except (OSError, PlainDataError, RecordingError, AssessmentFileError):
            return None
