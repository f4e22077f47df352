"""Provenance of a number: the recordings, and the random draws with their seed, from which it was computed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from fitting.cuffs.cuffs_file import CUFFS_FILE
from station.assessment.assessment_json import ASSESSMENT_FILE
from station.report.report_file import Source

Plain = Mapping[str, Any]

WITHOUT_CUFFS = frozenset({"rigid", "bare_body_cost", "longest_cord_m", "reference_rest_length_m", "emg"})
"""Keys of assessment.json whose numbers do not depend on the cuffs."""


@dataclass(frozen=True)
class Draws:
    """Number of random draws, and the seed of their generator."""

    count: int
    seed: int


@dataclass(frozen=True)
class Provenance:
    """Provenance of the numbers in cuffs.json and assessment.json, given as plain data; None without the file."""

    cuffs: Plain | None
    assessment: Plain | None

    def recordings(self, source: Source) -> tuple[str, ...]:
        """Recordings from whose samples the value at this place was computed, including those of the calibration."""
        keys = source.keys
        if source.file.endswith(".mcap"):
            return (source.file,)
        if source.file == CUFFS_FILE:
            return tuple(dict.fromkeys(self._behind_cuffs_file(keys)))
        if source.file == ASSESSMENT_FILE and self.assessment is not None:
            return tuple(dict.fromkeys(self._behind_assessment(keys, self.assessment)))
        return ()

    def draws(self, source: Source) -> Draws | None:
        """Draws behind the interval of an assessed number; None for other numbers."""
        if source.file != ASSESSMENT_FILE or self.assessment is None or source.keys[:1] in (["cuffs"], ["subject"]):
            return None
        settings = self.assessment.get("uncertainty")
        return Draws(int(settings["people"]["value"]), int(settings["seed"]["value"])) if settings else None

    def _behind_cuffs_file(self, keys: list[str]) -> Iterable[str]:
        plain = self.cuffs or {}
        calibration = list((plain.get("calibration") or {}).get("sources", {}))
        if keys[:1] == ["calibration"]:
            return calibration
        if keys[:1] == ["rejected"]:
            return [plain["rejected"][int(keys[1])]["file"]]
        cuff = plain.get("cuffs", {}).get(keys[1] if len(keys) > 1 else "", {})
        if keys[2:3] == ["trials"]:
            return [cuff["trials"][int(keys[3])]["file"], *calibration]
        return [*cuff.get("sources", ()), *calibration]

    def _behind_assessment(self, keys: list[str], assessment: Plain) -> Iterable[str]:
        wearer = [trial["file"] for trial in (assessment.get("subject") or {}).get("trials", ()) if "file" in trial]
        if keys[:1] == ["subject"]:
            return wearer
        worn = assessment.get("cuffs") or {}
        named = [name for name in keys if name in worn]
        if not named and not WITHOUT_CUFFS & set(keys):
            named = list(worn)
        waist = assessment.get("waist_cuff")
        behind = [file for name in dict.fromkeys([waist, *named]) if named and name for file in self._fitted_from(name)]
        return [*behind, *wearer]

    def _fitted_from(self, cuff: str) -> Iterable[str]:
        return self._behind_cuffs_file(["cuffs", cuff])
