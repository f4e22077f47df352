"""The command line, run in this process; a wearer's session, recorded once."""

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.errors import DeviceError
from fitting.cuffs.cuff_fit import SessionFit
from fitting.cuffs.cuffs_file import cuffs_json
from fitting.errors import CodedError
from solver.errors import SolverError
from station import cli
from station.errors import StationError
from tests.made_once import made_once
from tests.station.command import Ran, command_of
from tests.station.wearer import WearerSession, record_wearer


@pytest.fixture(scope="session")
def wearer(tmp_path_factory: pytest.TempPathFactory) -> WearerSession:
    return made_once(tmp_path_factory, "wearer", lambda folder: record_wearer(folder / "simulated" / "session"))


@pytest.fixture(scope="session")
def reported(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session with its report (tests/station/reported.py). Tests read it; who writes copies it."""
    from tests.station.reported import report_session  # with all that a report needs, for the tests that have one

    return made_once(tmp_path_factory, "reported", report_session)


@pytest.fixture(scope="session")
def fitted_waist() -> SessionFit:
    """A waist cuff and no arm cuff, as if every trial of the arm cuff had failed."""
    from fitting.session import fit_session
    from fitting.trial.trial import build_trial
    from tests.fitting.experiment import Session, published

    session = Session(published("waist", hold=4.0, duration=12.0), 3)
    return fit_session([build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")])


@pytest.fixture
def given_fit(fitted_waist: SessionFit, monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit of every session is that of the waist cuff."""

    def fit(_folder: Path, output: Path | None, *_: object) -> SessionFit:
        if output is not None:
            output.write_text(cuffs_json(fitted_waist), encoding="utf-8")
        return fitted_waist

    monkeypatch.setattr("station.fit.fit_session_folder", fit)


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
