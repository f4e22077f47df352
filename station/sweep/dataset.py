"""Run a sweep: solve the cases that are not finished, and write a table of all cases.

The output is a file per finished case, and at the end a Parquet table of all cases.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from documents.plain_data import PlainDataError, read_json
from solver.suit.optimise import LEAST_FRAMES
from solver.suit.suit import PARTS
from station.messages.message import Message
from station.messages.sweep_codes import SweepCode
from station.output_folder import ensure_folder
from station.progress import Progress, silent
from station.sweep.cases import Case, SweepInputs
from station.sweep.solving import ERRORS, RESULTS, Outcome, Task
from station.sweep.sweep_plan import AXES, SweepPlan
from station.versions import solving_versions
from station.whole_file import drafted, write_whole

Solve = Callable[[Iterable[Task]], Iterator[tuple[dict[str, Outcome], bool]]]
"""Tasks → outcomes by key of the cases, and whether they are final; see cluster.solve_on."""
TABLE_FILE, PROVENANCE_FILE, PARTS_FOLDER = "sweep.parquet", "sweep.json", "parts"
NAMES = ("model", "motion", "external_loads", "suit", "cuffs", "cuff", "condition")
COUNTS = ("case", "frames", "unsolved")


@dataclass(frozen=True)
class SweepResult:
    """The table, and the numbers of cases that failed, were finished by an earlier run, or have unsolved frames.

    first_error  why the first case that failed did so;  findings  on the plan as a whole
    """

    table: Path
    cases: int
    found_finished: int
    failed: int
    unsolved: int
    first_error: str | None = None
    findings: tuple[Message[SweepCode], ...] = ()


def run_sweep(plan: SweepPlan, output: Path, solve: Solve, progress: Progress = silent) -> SweepResult:
    """Run or continue a sweep. A case that fails is a row of the table with the reason.

    After Ctrl-C, a signal or a power failure, the same call continues with the remaining cases. Raises PlanError, or
    the errors of the readers, before the first case is solved.
    """
    ensure_folder(output)
    inputs, parts = SweepInputs(plan), Parts(output)
    write_provenance(output, plan, len(inputs.cases))
    known = {case.key: parts.read(case.key) for case in inputs.cases}
    outcomes = {key: outcome for key, outcome in known.items() if outcome is not None}
    found = sum(case.key in outcomes for case in inputs.cases)
    progress("solving cases", len(outcomes), len(known))
    for solved, is_final in solve(inputs.tasks([case for case in inputs.cases if case.key not in outcomes])):
        for key, outcome in solved.items():
            if is_final:
                parts.write(key, outcome)
            outcomes[key] = outcome
        progress("solving cases", len(outcomes), len(known))
    table = write_table(output, plan, inputs.cases, outcomes)
    rows = [outcomes[case.key] for case in inputs.cases]
    errors = [str(outcome["error"]) for outcome in rows if outcome["error"] is not None]
    return SweepResult(
        table=table,
        cases=len(rows),
        found_finished=found,
        failed=len(errors),
        unsolved=sum(bool(outcome["unsolved"]) for outcome in rows),
        first_error=errors[0] if errors else None,
        findings=_few_frames(plan.every, rows),
    )


def _few_frames(every: int, rows: Sequence[Outcome]) -> tuple[Message[SweepCode], ...]:
    """A finding where the plan leaves fewer frames of a motion than a search for a suit tries."""
    frames = [float(row["frames"]) for row in rows if row["frames"] is not None]
    few = sum(count < LEAST_FRAMES for count in frames)
    if every == 1 or not few:
        return ()
    figures = {"every": every, "cases": few, "fewest": min(frames), "least": LEAST_FRAMES}
    return (Message(SweepCode.FEW_FRAMES, figures),)


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
