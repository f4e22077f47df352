"""What a sweep leaves: a part for every finished case, and in the end one Parquet table of all of them."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_json
from solver.suit.suit import PARTS
from station.sweep.cases import Case
from station.sweep.plan import AXES, SweepPlan
from station.sweep.solving import RESULTS, Outcome
from station.versions import solving_versions
from station.whole_file import drafted, write_whole

TABLE_FILE, ACCOUNT_FILE, PARTS_FOLDER = "sweep.parquet", "sweep.json", "parts"
NAMES = ("model", "motion", "external_loads", "suit", "cuffs", "cuff", "condition")
COUNTS = ("case", "frames", "unsolved")


class Parts:
    """The finished cases in a folder, a file each, there whole or not at all; a key is never used for two results."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / PARTS_FOLDER

    def read(self, key: str) -> Outcome | None:
        """None where the case is not finished, or its file was damaged."""
        try:
            found: Outcome = read_json(self._path(key))
        except (OSError, PlainDataError):
            return None
        return found if isinstance(found, dict) and set(found) == {*RESULTS, "error"} else None

    def write(self, key: str, outcome: Outcome) -> None:
        write_whole(self._path(key), json.dumps(outcome, allow_nan=False) + "\n")

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def write_account(folder: Path, plan: SweepPlan, cases: int) -> None:
    """sweep.json: which plan is swept into this folder, and by what."""
    plain = {"plan_sha256": plan.digest, "cases": cases, "versions": solving_versions()}
    write_whole(folder / ACCOUNT_FILE, json.dumps(plain, indent=2) + "\n")


def write_table(folder: Path, plan: SweepPlan, cases: Sequence[Case], outcomes: Mapping[str, Outcome]) -> Path:
    """sweep.parquet: a row per case in the plan's order; the same cases and outcomes give the same bytes."""
    import pyarrow as pa
    from pyarrow import parquet

    rows = [{**_design(case), **outcomes[case.key], "remarks": case.remarks, "key": case.key} for case in cases]
    kinds = {**dict.fromkeys(COUNTS, pa.int64()), **dict.fromkeys([*NAMES, "error", "remarks", "key"], pa.string())}
    fields = [pa.field(name, kinds.get(name, pa.float64())) for name in rows[0]]
    about = {"plan_sha256": plan.digest, "versions": json.dumps(solving_versions())}
    table = pa.Table.from_pylist(rows, schema=pa.schema(fields, metadata=about))
    path = folder / TABLE_FILE
    with drafted(path) as draft:
        parquet.write_table(table, draft)
    return path


def _design(case: Case) -> dict[str, Any]:
    """A case's values, those of the suit as they are worn."""
    suit = case.worn.suit
    cord: dict[str, float] = {"rest_length_m": suit.reference_rest_length, "stiffness_n_per_m": suit.stiffness}
    for part in PARTS:
        location = getattr(suit, part).location
        cord |= {f"{part}_{axis}_m": float(value) for axis, value in zip("xyz", location, strict=True)}
    named = {axis: case.point[axis] for axis in AXES if axis in (*NAMES, "hand_mass_kg")}
    return {"case": case.number, **named, **cord}
