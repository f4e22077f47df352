"""Processes of this machine, or a Dask cluster, that solve tasks."""

from __future__ import annotations

import logging
import tempfile
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from itertools import islice
from typing import Any, TypeVar

from distributed import Client, Future, LocalCluster, as_completed

from documents.message import Message, because
from station.errors import StationError
from station.messages.study_messages import SweepCode

MOST_SUBMITTED = 64
"""Tasks submitted at a time, which limits the memory of the scheduler."""
CONNECT_TIMEOUT = 10  # s

Given = TypeVar("Given")


class ClusterError(StationError):
    """The cluster cannot be used."""


@contextmanager
def connected(scheduler: str | None, workers: int) -> Iterator[Client]:
    """A client of the scheduler at this address, or of `workers` processes of this machine, which end with it.

    Local processes listen on 127.0.0.1 only and serve no dashboard. Raises ClusterError if the scheduler is silent.
    """
    with ExitStack() as stack:
        address = scheduler or stack.enter_context(_local_cluster(workers))
        try:
            client = stack.enter_context(Client(address, timeout=CONNECT_TIMEOUT))
        except (OSError, ValueError) as error:
            figures = {"address": str(scheduler), **because(error)}
            raise ClusterError(Message(SweepCode.NO_SCHEDULER, figures)) from error
        yield client


def completed_tasks(
    client: Client, solve: Callable[[Given], Any], tasks: Iterable[Given]
) -> Iterator[tuple[Given, Future[Any]]]:
    """Every task with its future as it ends; at most MOST_SUBMITTED of them are submitted at a time."""
    remaining = iter(tasks)
    running: dict[Future[Any], Given] = {}

    def submit(most: int) -> list[Future[Any]]:
        submitted = {client.submit(solve, task, pure=False): task for task in islice(remaining, most)}
        running.update(submitted)
        return list(submitted)

    completed = as_completed(submit(MOST_SUBMITTED))
    for future in completed:
        yield running.pop(future), future
        completed.update(submit(1))


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
