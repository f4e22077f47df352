"""The command line, run in this process; a wearer's session, recorded once."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import DeviceError
from fitting.errors import CodedError
from solver.errors import SolverError
from station import cli
from station.errors import StationError
from tests.made_once import made_once
from tests.station.command import Ran, command_of
from tests.station.reported import report_session
from tests.station.wearer import WearerSession, record_wearer


@pytest.fixture(scope="session")
def wearer(tmp_path_factory: pytest.TempPathFactory) -> WearerSession:
    return made_once(tmp_path_factory, "wearer", lambda folder: record_wearer(folder / "simulated" / "session"))


@pytest.fixture(scope="session")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with its report (tests/station/reported.py). Tests read it; who writes copies it."""
    return made_once(tmp_path_factory, "reported", report_session)


@pytest.fixture
def station(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Callable[..., Ran]:
    def run(*arguments: object) -> Ran:
        codes = [""]
        app = cli.app

        def app_with_code(**options: str) -> None:
            try:
                app(**options)
            except CodedError as error:
                codes.append(error.reason.code)
                raise
            except (StationError, DeviceError, SolverError) as error:
                codes.append(error.code)
                raise

        with monkeypatch.context() as patch:
            patch.setattr(sys, "argv", ["station", *map(str, arguments)])
            patch.setattr(cli, "app", app_with_code)
            patch.setattr("typer.main.get_command", command_of)
            with pytest.raises(SystemExit) as caught:
                cli.main()
        captured = capsys.readouterr()
        return Ran(int(caught.value.code or 0), captured.out, captured.err, codes[-1])

    return run
