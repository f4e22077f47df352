"""Options and the account of what was skipped."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import HealthCheck, settings

# The matrices here are small: threads only wait for each other, several times the work on a machine that is busy.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # before NumPy comes

# Machines are shared and slow at times: how long an example takes is no finding. The same examples every time: a gate
# that fails by chance teaches nobody; new ones are sought by `python -m benchmarks.fuzz`.
settings.register_profile("house", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("house")

SHARED = Path(__file__).parents[1].parent / "shared" / "data"


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--hardware", action="store_true", help="run the contract tests against the bench as well")
    parser.addoption("--pictures", metavar="DIR", help="where the tests in a browser leave their screenshots")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    for item in items:
        if "hardware" in item.keywords and not config.getoption("--hardware"):
            item.add_marker(pytest.mark.skip(reason="needs the bench: run with --hardware"))
        if "shared" in item.keywords and not SHARED.is_dir():
            item.add_marker(pytest.mark.skip(reason="the public data set is not beside the repository"))


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    skipped = [r for r in terminalreporter.stats.get("skipped", []) if "public data set" in str(r.longrepr)]
    terminalreporter.write_line(f"tests skipped for want of the public data set: {len(skipped)}")
