"""One root of exceptions for each folder: what the command line shows as a sentence, and with which exit code."""

import ast
import importlib

import pytest

import cuffstation
from documents.plain_data import PlainDataError
from drivers.errors import DeviceError
from fitting.errors import FitError
from recordings.errors import RecordingError
from solver.errors import SolverError
from station import cli
from station.config import ConfigError
from station.errors import StationError
from tests.house.sources import ROOT, nodes_of

ROOTS: dict[str, type[Exception]] = {
    "station": StationError,
    "drivers": DeviceError,
    "fitting": FitError,
    "recordings": RecordingError,
    "solver": SolverError,
    "documents": PlainDataError,
}


@pytest.mark.parametrize("folder", ROOTS)
def test_every_public_exception_of_a_folder_derives_from_its_root(folder: str) -> None:
    found = [getattr(importlib.import_module(module), name, None) for module, name in _classes_in(folder)]
    raised = {kind for kind in found if isinstance(kind, type) and issubclass(kind, Exception)}
    assert ROOTS[folder] in raised
    assert {kind.__name__ for kind in raised if not issubclass(kind, ROOTS[folder])} == set()


@pytest.mark.parametrize(
    ("error", "code"), [*((kind("the reason"), 1) for kind in ROOTS.values()), (ConfigError("x"), 2)]
)
def test_the_command_line_ends_with_the_sentence_and_the_exit_code_of_the_root(
    error: Exception, code: int, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _ended(error, monkeypatch) == code
    shown = f" [{stable}]" if (stable := getattr(error, "code", "")) else ""
    assert capsys.readouterr().err == f"station: {error}{shown}\n"


def test_any_other_exception_is_a_bug_and_the_library_hands_the_roots_on(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(ZeroDivisionError):
        _ended(ZeroDivisionError("a bug"), monkeypatch)
    roots = {kind for folder, kind in ROOTS.items() if folder != "documents"}
    assert roots <= {getattr(cuffstation, name) for name in cuffstation.__all__}


def _classes_in(folder: str) -> list[tuple[str, str]]:
    """Module and name of every public class."""
    return [
        (path.relative_to(ROOT).with_suffix("").as_posix().replace("/", "."), node.name)
        for path in sorted((ROOT / folder).rglob("*.py"))
        if path.stem != "__main__"
        for node in nodes_of(path)
        if isinstance(node, ast.ClassDef) and not node.name.startswith("_")
    ]


def _ended(error: Exception, monkeypatch: pytest.MonkeyPatch) -> object:
    def fail(**_options: str) -> None:
        raise error

    monkeypatch.setattr(cli, "app", fail)
    with pytest.raises(SystemExit) as ended:
        cli.main()
    return ended.value.code
