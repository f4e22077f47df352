"""One recorded session for all tests of the house, recorded by the first process that needs it."""

import shutil
from functools import partial
from pathlib import Path

import pytest

from tests.house import one_cuff
from tests.made_once import made_once


@pytest.fixture(scope="session")
def recorded_session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The session of tests/house/one_cuff.py, fitted and with its report. Tests read it; who writes uses session."""
    return made_once(tmp_path_factory, "recorded_one_cuff", partial(one_cuff.main, is_pinned=False))


@pytest.fixture(scope="module")
def session(recorded_session: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the session, which the tests of a module may change."""
    return Path(shutil.copytree(recorded_session, tmp_path_factory.mktemp("copied") / "session"))
