"""plan.toml → sweep.parquet: solve what is not finished, keep what is, and put all of it into one table."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from station.assessment.assessment_inputs import ensure_folder
from station.progress import Progress, silent
from station.sweep.cases import SweepInputs
from station.sweep.dataset import Parts, write_account, write_table
from station.sweep.plan import SweepPlan
from station.sweep.solving import Outcome, Task

Solve = Callable[[Iterable[Task]], Iterator[tuple[dict[str, Outcome], bool]]]
"""Tasks → key of a case and its outcome, and whether that is for good; see cluster.solve_on."""


@dataclass(frozen=True)
class Swept:
    """The table, and how many of its cases failed, were finished by an earlier run, or have frames left unsolved."""

    table: Path
    cases: int
    found_finished: int
    failed: int
    unsolved: int


def run_sweep(plan: SweepPlan, output: Path, solve: Solve, progress: Progress = silent) -> Swept:
    """Raises PlanError, or what a reader raises, before anything is solved; a case that fails is a row that says why.

    However it is ended, by Ctrl-C, a signal or a power cut, the same call goes on with what is left.
    """
    ensure_folder(output)
    inputs, parts = SweepInputs(plan), Parts(output)
    write_account(output, plan, len(inputs.cases))
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
    each = [outcomes[case.key] for case in inputs.cases]
    return Swept(
        table=table,
        cases=len(each),
        found_finished=found,
        failed=sum(outcome["error"] is not None for outcome in each),
        unsolved=sum(bool(outcome["unsolved"]) for outcome in each),
    )
