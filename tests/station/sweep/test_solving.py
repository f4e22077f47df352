"""Sweeps on real worker processes: killed worker, killed sweep, silent scheduler, no access from other machines."""

import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from urllib.error import HTTPError
from urllib.request import urlopen

import dask
import numpy as np
import pandas as pd
import psutil
import pytest
from distributed import Client
from distributed.utils import get_mp_context

from solver.uncertainty.factors import normal_scores, unit_sample
from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleError, PeopleRun, run_people, solve_people_on
from station.dask_cluster import ClusterError, connected
from station.messages.assessment_messages import InputCode
from station.messages.study_messages import SweepCode
from station.sweep.dataset import SweepResult, run_sweep, solve_on, solve_task
from station.sweep.sweep_plan import SweepPlan, read_plan
from tests.refusals import raises_refusal
from tests.solver.uncertainty.test_people import CASE
from tests.station.sweep.test_dataset import write_plan
from tests.timeout import scaled_timeout

VARY = 'condition = ["rigid", "both"]\nrest_length_m = [0.7, 0.74]\nhand_mass_kg = [0, 0.5, 1, 1.5, 2]'

KILLED_SWEEP = """
import sys
from functools import partial
from pathlib import Path
import psutil
from station.dask_cluster import connected
from station.sweep.dataset import solve_on
from station.sweep.sweep_plan import read_plan
from station.sweep.dataset import run_sweep

def kill_at_half(what, done, total):
    if 2 * done >= total:
        psutil.Process().kill()

if __name__ == "__main__":
    scheduler, plan, output = sys.argv[1:]
    with connected(scheduler, 1) as client:
        run_sweep(read_plan(Path(plan)), Path(output), partial(solve_on, client), kill_at_half)
"""


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> SweepPlan:
    return read_plan(write_plan(tmp_path_factory.mktemp("plan"), VARY))


@pytest.fixture(scope="module")
def ran_through(plan: SweepPlan) -> bytes:
    """The table of a sweep that nothing happened to, without a cluster."""
    table = run_sweep(plan, plan.folder / "through", lambda tasks: ((solve_task(task), True) for task in tasks)).table
    return table.read_bytes()


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Workers are forks of a process with their imports, except on Windows; docs/commands.md starts them anew."""
    method = "spawn" if sys.platform == "win32" else "forkserver"
    with dask.config.set({"distributed.worker.multiprocessing-method": method}):
        get_mp_context().set_forkserver_preload(["distributed", "station.sweep.dataset"])
        with connected(None, 2) as client:
            yield client


def at(count: int, act: Callable[[], None]) -> Callable[[str, int, int], None]:
    """A progress that acts once, when so many cases are finished."""
    due = [act]

    def progress(what: str, done: int, total: int) -> None:
        if done >= count and due:
            due.pop()()

    return progress


@pytest.mark.slow
def test_a_sweep_survives_a_killed_worker(client: Client, plan: SweepPlan, ran_through: bytes, tmp_path: Path) -> None:
    processes = client.run(os.getpid)
    victim = next(iter(processes.values()))

    found = run_sweep(plan, tmp_path, partial(solve_on, client), at(1, lambda: psutil.Process(victim).kill()))
    assert errors_in(found) == []
    assert found.table.read_bytes() == ran_through
    client.wait_for_workers(2, timeout=scaled_timeout(60))
    assert victim not in client.run(os.getpid).values()


@pytest.mark.slow
def test_a_killed_sweep_is_continued(client: Client, plan: SweepPlan, ran_through: bytes, tmp_path: Path) -> None:
    """The killed program used a running scheduler, which does not end with it."""
    script = tmp_path / "killed.py"
    script.write_text(KILLED_SWEEP, encoding="utf-8")
    output = tmp_path / "out"
    command = [sys.executable, str(script), client.scheduler.address, str(plan.folder / "plan.toml"), str(output)]
    killed = subprocess.run(command, cwd=Path(__file__).parents[3], capture_output=True, text=True, check=False)  # noqa: S603
    assert killed.returncode not in (0, 1), killed.stderr
    assert not (output / "sweep.parquet").exists()
    assert client.status == "running"
    found = run_sweep(plan, output, partial(solve_on, client))
    assert 0 < found.found_finished < found.cases
    assert found.table.read_bytes() == ran_through


@pytest.mark.slow
def test_an_unexpected_error_is_a_row_and_the_case_is_repeated(
    client: Client, plan: SweepPlan, ran_through: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("station.sweep.dataset.solve_task", divide_by_zero)
    failed = run_sweep(plan, tmp_path, partial(solve_on, client))
    assert (failed.cases, failed.failed) == (40, 40)
    monkeypatch.undo()
    found = run_sweep(plan, tmp_path, partial(solve_on, client))
    assert (found.found_finished, errors_in(found)) == (0, [])
    assert found.table.read_bytes() == ran_through


@pytest.mark.slow
def test_drawn_people_are_the_same_on_a_cluster_as_here(client: Client, monkeypatch: pytest.MonkeyPatch) -> None:
    """To the last bits: a processor of a worker may add in another order. An unexpected error there is a refusal."""
    scores = normal_scores(unit_sample(CASE.factors, 2, "latin_hypercube", seed=1))
    there = run_people(CASE, scores, PeopleRun(read_budget(), None, partial(solve_people_on, client)))
    here = run_people(CASE, scores, PeopleRun(read_budget()))
    for place, reading in here.items():
        np.testing.assert_allclose(there[place].at_reference, reading.at_reference, rtol=1e-12)
    monkeypatch.setattr("station.assessment.people_run.solve_people_task", divide_by_zero)
    with raises_refusal(InputCode.PEOPLE_FAILED, kind=PeopleError):
        run_people(CASE, scores, PeopleRun(read_budget(), None, partial(solve_people_on, client)))


@pytest.mark.slow
def test_local_workers_listen_to_this_machine_only_and_serve_no_dashboard(client: Client) -> None:
    account = client.scheduler_info()
    addresses = [account["address"], *account["workers"]]
    assert all(address.startswith("tcp://127.0.0.1:") for address in addresses)
    ports = [process["services"]["dashboard"] for process in (account, *account["workers"].values())]
    for port in ports:
        with pytest.raises(HTTPError, match="404"):
            urlopen(f"http://127.0.0.1:{port}/status")  # where a dashboard would be


def test_a_scheduler_that_does_not_answer_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("station.dask_cluster.CONNECT_TIMEOUT", 1)
    with raises_refusal(SweepCode.NO_SCHEDULER, kind=ClusterError), connected("tcp://127.0.0.1:9", 1):
        pytest.fail("no scheduler listens there")


def errors_in(swept: SweepResult) -> list[str]:
    """The sentences of the cases that failed, of which there should be forty."""
    table = pd.read_parquet(swept.table)
    assert len(table) == 40
    return list(table["error"].dropna())


def divide_by_zero(task: object) -> None:
    raise ZeroDivisionError("of a test")
