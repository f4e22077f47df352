"""One recorded session for all tests of the house, recorded by the first process that needs it."""

from __future__ import annotations

import os
import shutil
from pathlib import Path

import pytest
from filelock import FileLock

from tests.house import one_cuff


@pytest.fixture(scope="session")
def recorded_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session of tests/house/one_cuff.py, fitted and with its report. Tests read it; who writes uses session."""
    base = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        base = base.parent  # of all processes of this run
    folder = base / "recorded_one_cuff"
    with FileLock(base / "one_cuff.lock"):
        if not (folder / "report.html").is_file():
            shutil.rmtree(folder, ignore_errors=True)
            one_cuff.main(folder, is_pinned=False)
    return folder


@pytest.fixture(scope="module")
def session(recorded_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the session, which the tests of a module may change."""
    return Path(shutil.copytree(recorded_session, tmp_path_factory.mktemp("copied") / "session"))
