"""Options, time-outs that scale with the load of the machine, and the account of what was skipped."""

import gc
import os
import sys
from collections.abc import Generator
from contextlib import suppress
from pathlib import Path

import psutil
import pytest
from hypothesis import HealthCheck, settings

from tests.timeout import count_cores, scaled_timeout

# The matrices here are small: threads only wait for each other, several times the work on a machine that is busy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes

# Without bytecode, every process that the tests start would compile the project anew, and so would every run of them.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

# Machines are shared and slow at times: how long an example takes is no finding. The same examples every time: a gate
# that fails by chance is ignored; new ones are sought by `python -m benchmarks.fuzz`.
settings.register_profile("house", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("house")

SHARED = Path(__file__).parents[1].parent / "shared" / "data"


@pytest.fixture(autouse=True, scope="session")
def no_claims_in_the_home_folder(tmp_path_factory: pytest.TempPathFactory) -> Generator[None]:
    """Notes of the DAQ sessions of tests must not reach the home folder of the user who runs them."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("drivers.nidaq_session.FOLDER", str(tmp_path_factory.mktemp("claims")))
        yield


@pytest.fixture(autouse=True, scope="module")
def recorders_end(tmp_path_factory: pytest.TempPathFactory) -> Generator[None]:
    """A recorder outlives its console, by design: what a test leaves running would slow down all that follow."""
    yield
    folder = tmp_path_factory.getbasetemp()
    for process in psutil.process_iter():
        with suppress(psutil.Error, OSError):
            if os.name == "posix" and process.pid != os.getpid() and folder in Path(process.cwd()).parents:
                process.kill()


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--hardware", action="store_true", help="run the contract tests against the bench as well")
    parser.addoption("--pictures", metavar="DIR", help="where the tests in a browser leave their screenshots")
    parser.addoption("--served-by", metavar="PYTHON", help="runs the consoles that tests in a browser look at")


def pytest_xdist_auto_num_workers(config: pytest.Config) -> int:
    """No test processes with --hardware, since there is one bench; else two more than cores.

    Part of the time is spent waiting: for a simulated bench, a browser, another process.
    """
    return 0 if config.getoption("--hardware") else count_cores() + 2


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_collection() -> Generator[None, object, object]:
    """Without garbage collection: modules and tests stay to the end, and a pass over all takes half a second."""
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    """Scale the time-out when the test begins, just before pytest-timeout reads it."""
    item.add_marker(pytest.mark.timeout(scaled_timeout(_timeout_of(item))), append=False)
    return (yield)


def _timeout_of(item: pytest.Item) -> float:
    """Seconds on an idle machine: the test's own marker, else the command line's, else the configuration's."""
    if marker := item.get_closest_marker("timeout"):
        return float(marker.args[0])
    given = item.config.getoption("timeout")
    return float(item.config.getini("timeout") if given is None else given)


def _timeouts_of(items: list[pytest.Item]) -> float:
    return sum(map(_timeout_of, items))


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    items[:] = longest_first(items, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
    for item in items:
        if "hardware" in item.keywords and not config.getoption("--hardware"):
            item.add_marker(pytest.mark.skip(reason="needs the bench: run with --hardware"))
        if "shared" in item.keywords and not SHARED.is_dir():
            item.add_marker(pytest.mark.skip(reason="the public data set is not beside the repository"))


def longest_first(items: list[pytest.Item], processes: int) -> list[pytest.Item]:
    """Each process begins with its share of the tests that have a time-out of their own, the longest first.

    At the end of the run, one of them would leave the other processes without work. A process begins with an equal part
    of the list (worksteal in pyproject.toml); the other tests stay in their order. Two processes have all tests in a
    browser, because more browsers at once take the processor from each other; a module is in one of them, because it
    starts a browser of its own.
    """
    markers = {item: item.get_closest_marker("timeout") for item in items}
    long = sorted((item for item in items if markers[item]), key=_timeout_of, reverse=True)
    others = [item for item in items if not markers[item]]
    in_browser: dict[Path, list[pytest.Item]] = {}
    for item in long:
        if "browser" in item.fixturenames and processes > 2:
            in_browser.setdefault(item.path, []).append(item)
    rest = [item for item in long if item not in in_browser.get(item.path, [])]
    browsing = 2 if in_browser else 0
    shares: list[list[pytest.Item]] = [[] for _ in range(browsing)]
    for module in sorted(in_browser.values(), key=_timeouts_of, reverse=True):
        min(shares, key=_timeouts_of).extend(module)
    shares += [rest[process :: processes - browsing] for process in range(processes - browsing)]
    ordered: list[pytest.Item] = []
    for process, share in enumerate(shares):
        count = max(0, (len(items) - len(ordered)) // (processes - process) - len(share))
        ordered += share + others[:count]
        others = others[count:]
    return ordered + others


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if "public data set" in str(r.longrepr)]
    terminalreporter.write_line(f"tests skipped for want of the public data set: {len(skipped)}")
