"""Where a sweep is solved: on processes of this machine, or on a lab's Dask cluster."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import TypeAlias

from distributed import Client, Future, LocalCluster, as_completed

from station.errors import StationError
from station.sweep.solving import Outcome, Task, failed, solve_task

AHEAD = 64
"""Tasks handed out at once, so that what is still to do stays here and not in the scheduler's memory."""
CONNECT_TIMEOUT = 10  # s

Solved: TypeAlias = "Future[dict[str, Outcome]]"


class ClusterError(StationError):
    """No cluster to work on; one sentence."""


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Client]:
    """A client of the scheduler at this address, or of so many processes of this machine, which end with it.

    Local processes listen on 127.0.0.1 only and serve no dashboard. Raises ClusterError where nobody answers.
    """
    with ExitStack() as stack:
        where = scheduler or stack.enter_context(_local_cluster(workers))
        try:
            client = stack.enter_context(Client(where, timeout=CONNECT_TIMEOUT))
        except (OSError, ValueError) as error:
            raise ClusterError(
                f"no Dask scheduler answers at {scheduler} ({error}); start one with `dask scheduler` or leave "
                "--scheduler out"
            ) from error
        yield client


def solve_on(client: Client, tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """What came of each task's cases, as they finish, and whether they are finished for good.

    A task whose worker dies is given to another one. One that kills three in a row, or ends in an error of ours, comes
    back as failed cases that are not finished: a later run tries them again.
    """
    left = iter(tasks)
    running: dict[Solved, Task] = {}

    def submitted(most: int) -> list[Solved]:
        handed_out = {client.submit(solve_task, task, pure=False): task for task in islice(left, most)}
        running.update(handed_out)
        return list(handed_out)

    completed = as_completed(submitted(AHEAD))
    for future in completed:
        task, error = running.pop(future), future.exception()
        if error is None:
            yield future.result(), True
        else:
            sentence = f"the case was not solved ({type(error).__name__}: {error}); sweep again to try it once more"
            yield {case.key: failed(sentence) for case in task.cases}, False
        completed.update(submitted(1))


@contextmanager
def _local_cluster(workers: int) -> Iterator[LocalCluster]:
    with (
        tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as scratch,
        LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            host="127.0.0.1",
            dashboard_address="127.0.0.1:0",
            worker_dashboard_address="127.0.0.1:0",
            scheduler_kwargs={"dashboard": False},
            local_directory=scratch,
            silence_logs=logging.CRITICAL,
        ) as cluster,
    ):
        yield cluster
