"""What the library and the commands import before they do their work: seconds that a user waits for at every call."""

import json
import shutil
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

from station.__main__ import SPARE, main
from tests.timeout import scaled_timeout

HEAVY = (
    *("numpy", "pydantic", "scipy.signal", "scipy.special", "scipy.optimize", "scipy.spatial", "scipy.stats", "numba"),
    *("clarabel", "pandas", "matplotlib", "jinja2", "PIL", "pyarrow", "duckdb", "grpc", "nidaqmx", "nicegui", "rerun"),
    *("multiprocessing", "tomllib", "scipy.linalg"),
)
"""Modules that take 5 ms to 1 s to import."""
RECORDING = Path(__file__).parents[1] / "recordings/golden/format_1.mcap"
READING = {"numpy", "pydantic"}
COMMANDS: dict[str, set[str]] = {
    "--help": set(),
    "judge TRIAL": READING,
    "info TRIAL": READING,
    "recover TRIAL": READING,
    "export TRIAL --to csv --output EXPORTED": READING | {"tomllib"},
    "verify FOLDER": READING | {"tomllib", "jinja2"},  # it renders the report again
}
"""Command → which of HEAVY it may import. They run in one process, in this order."""

PROCESS = f"""
import contextlib, io, json, sys
import cuffstation
loaded = {{"import cuffstation": [name for name in {HEAVY} if name in sys.modules]}}
from station.cli import main
for command in json.loads(sys.argv[1]):
    sys.argv[1:] = command.split()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
        main()
    loaded[command] = [name for name in {HEAVY} if name in sys.modules]
print(json.dumps(loaded))
"""


@pytest.fixture(scope="module")
def loaded(tmp_path_factory: pytest.TempPathFactory) -> dict[str, set[str]]:
    """Command → which of HEAVY are imported after it."""
    folder = tmp_path_factory.mktemp("start")
    places = {"TRIAL": shutil.copy(RECORDING, folder), "FOLDER": folder, "EXPORTED": folder / "exported"}
    named = {command: " ".join(str(places.get(word, word)) for word in command.split()) for command in COMMANDS}
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", PROCESS, json.dumps(list(named.values()))], capture_output=True, text=True, check=True
    )
    found = json.loads(ran.stdout)
    assert (folder / "exported").is_dir()
    return {"import cuffstation": set(found["import cuffstation"])} | {
        command: set(found[words]) for command, words in named.items()
    }


@pytest.mark.parametrize("command", ["import cuffstation", *COMMANDS])
def test_a_command_imports_no_package_that_it_does_not_use(loaded: dict[str, set[str]], command: str) -> None:
    assert loaded[command] <= COMMANDS.get(command, set())


UNUSED_BY_BENCH = {"scipy.constants", "scipy.linalg", "scipy.spatial", "pandas", "rich", "nicegui"}
PROGRAMS: tuple[dict[str, set[str]], ...] = (
    {
        "station.session.trial_daemon": {"scipy", "numba", "pandas", "rich", "nicegui"},
        "station.session.worker": {"scipy", "numba", "pandas", "rich", "nicegui"},
        "station.session.fitted_judgement": {"scipy.linalg", "scipy.signal", "numba", "solver.model", "rich"},
        "station.console.server": {"scipy.linalg", "numba", "rich", "solver.model"},
        "station.terminal.sequencer": {"scipy.linalg", "scipy.signal", "numba"},
    },
    {"station.bench.simulator_process": UNUSED_BY_BENCH, "station.live.process": {"scipy.signal", "pandas", "nicegui"}},
)
"""Imported by a process in this order → what is not imported then. An operator waits for it before every trial."""


@pytest.mark.parametrize("modules", PROGRAMS, ids=["station", "simulated bench and live process"])
def test_recorder_terminal_console_and_simulated_bench_start_without_the_packages_of_fits(
    modules: dict[str, set[str]],
) -> None:
    code = "import importlib, sys\n" + "".join(
        f"importlib.import_module({module!r})\nprint(*{unused} & sys.modules.keys())\n"
        for module, unused in modules.items()
    )
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert dict(zip(modules, ran.stdout.split("\n"), strict=False)) == dict.fromkeys(modules, "")


@pytest.mark.skipif(sys.platform == "win32", reason="RLIMIT_AS is a limit of POSIX")
@pytest.mark.parametrize(
    ("megabytes", "command", "code"),
    [
        (60, "--help", 1),
        (200, "info", 1),  # waited for ever: OpenBLAS tries again until it gets its memory
        (550, "rmr", 1),  # LLVM could abort
        (1100, "catalogue", 1),  # DuckDB could abort
        (550, "judge", 0),  # loads no LLVM
        (550, "export --to parquet", 1),
        (550, "export --to=parquet", 1),
    ],
)
def test_a_limit_of_memory_below_what_a_command_needs_is_a_sentence(
    megabytes: int, command: str, code: int, tmp_path: Path
) -> None:
    trial = shutil.copy(RECORDING, tmp_path)
    program = (
        f"import resource; resource.setrlimit(resource.RLIMIT_AS, 2 * ({megabytes * 2**20},)); "
        "from station.__main__ import main; main()"
    )
    ran = subprocess.run(  # noqa: S603
        [sys.executable, "-c", program, *command.split(), *[trial] * (command != "--help")],
        capture_output=True,
        text=True,
        timeout=scaled_timeout(60),
        check=False,
    )
    assert (ran.returncode, ran.stderr.count("\n")) == (code, 1)
    assert ran.stderr.startswith("station: the memory") is (code == 1)


def test_what_fails_for_lack_of_memory_is_a_sentence_and_any_other_failure_is_shown(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    unmapped = ImportError("libx.so: failed to map segment from shared object")
    monkeypatch.setattr("station.cli.main", Mock(side_effect=unmapped))
    monkeypatch.setattr("station.__main__._has_limit", lambda: True)
    monkeypatch.setattr("station.__main__._is_free", lambda size: True)
    with pytest.raises(ImportError):
        main()
    monkeypatch.setattr("station.__main__._is_free", lambda size: size > SPARE)
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code == 1
    assert "memory" in capsys.readouterr().err
