"""Run a sweep: solve the cases that are not finished, and write a table of all cases."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from solver.suit.optimise import LEAST_FRAMES
from station.messages.message import Message
from station.messages.sweep_codes import SweepCode
from station.output_folder import ensure_folder
from station.progress import Progress, silent
from station.sweep.cases import SweepInputs
from station.sweep.dataset import Parts, write_provenance, write_table
from station.sweep.plan import SweepPlan
from station.sweep.solving import Outcome, Task

Solve = Callable[[Iterable[Task]], Iterator[tuple[dict[str, Outcome], bool]]]
"""Tasks → outcomes by key of the cases, and whether they are final; see cluster.solve_on."""


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
