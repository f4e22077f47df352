"""Output of a sweep: a file per finished case, and at the end a Parquet table of all cases."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_json
from solver.suit.suit import PARTS
from station.sweep.cases import Case
from station.sweep.plan import AXES, SweepPlan
from station.sweep.solving import ERRORS, RESULTS, Outcome
from station.versions import solving_versions
from station.whole_file import drafted, write_whole

TABLE_FILE, PROVENANCE_FILE, PARTS_FOLDER = "sweep.parquet", "sweep.json", "parts"
NAMES = ("model", "motion", "external_loads", "suit", "cuffs", "cuff", "condition")
COUNTS = ("case", "frames", "unsolved")


class Parts:
    """Finished cases in a folder, one file per case, written atomically under its key."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / PARTS_FOLDER

    def read(self, key: str) -> Outcome | None:
        """The outcome; None for a case that is not finished, or whose file is damaged."""
        try:
            found: Outcome = read_json(self._path(key))
        except (OSError, PlainDataError):
            return None
        return found if isinstance(found, dict) and set(found) == {*RESULTS, *ERRORS} else None

    def write(self, key: str, outcome: Outcome) -> None:
        write_whole(self._path(key), json.dumps(outcome, allow_nan=False) + "\n")

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def write_provenance(folder: Path, plan: SweepPlan, cases: int) -> None:
    """Write sweep.json: the plan of this folder, and the versions of the solver."""
    plain = {"plan_sha256": plan.digest, "cases": cases, "versions": solving_versions()}
    write_whole(folder / PROVENANCE_FILE, json.dumps(plain, indent=2) + "\n")


def write_table(folder: Path, plan: SweepPlan, cases: Sequence[Case], outcomes: Mapping[str, Outcome]) -> Path:
    """Write sweep.parquet: a row per case in the order of the plan; equal cases and outcomes give equal bytes."""
    import pyarrow as pa
    from pyarrow import parquet

    rows = [{**_design(case), **outcomes[case.key], "remarks": case.remarks, "key": case.key} for case in cases]
    kinds = {**dict.fromkeys(COUNTS, pa.int64()), **dict.fromkeys([*NAMES, *ERRORS, "remarks", "key"], pa.string())}
    fields = [pa.field(name, kinds.get(name, pa.float64())) for name in rows[0]]
    metadata = {"plan_sha256": plan.digest, "versions": json.dumps(solving_versions())}
    table = pa.Table.from_pylist(rows, schema=pa.schema(fields, metadata=metadata))
    path = folder / TABLE_FILE
    with drafted(path) as draft:
        parquet.write_table(table, draft)
    return path


def _design(case: Case) -> dict[str, Any]:
    """The values of a case, with the parameters of the suit as it is worn."""
    suit = case.worn.suit
    cord: dict[str, float] = {"rest_length_m": suit.reference_rest_length, "stiffness_n_per_m": suit.stiffness}
    for part in PARTS:
        location = getattr(suit, part).location
        cord |= {f"{part}_{axis}_m": float(value) for axis, value in zip("xyz", location, strict=True)}
    axes = {axis: case.point[axis] for axis in AXES if axis in (*NAMES, "hand_mass_kg")}
    return {"case": case.number, **axes, **cord}
