"""Solve a sweep on processes of this machine, or on a Dask cluster."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from distributed import Client

from station.dask_cluster import completed_tasks
from station.messages.message import Message
from station.messages.sweep_codes import SweepCode
from station.sweep.solving import Failure, Outcome, Task, failed, solve_task


def solve_on(client: Client, tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """Outcomes by key of the cases of every task as it ends, and whether they are final.

    A task whose worker dies is repeated on another one. A task that kills three workers in a row, or ends in an
    unexpected error, gives failed cases that are not final: a later run repeats them.
    """
    for task, future in completed_tasks(client, solve_task, tasks):
        error = future.exception()
        if error is None:
            yield future.result(), True
        else:
            reason = Message(SweepCode.CASE_FAILED, {"reason": f"{type(error).__name__}: {error}"})
            failure = Failure(str(reason), reason.code)
            yield {case.key: failed(failure) for case in task.cases}, False
