"""What the library and the commands import before they do their work: seconds that a user waits for at every call."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HEAVY = (
    *("numpy", "pydantic", "scipy.signal", "scipy.special", "scipy.optimize", "scipy.spatial", "scipy.stats", "numba"),
    *("clarabel", "pandas", "matplotlib", "jinja2", "PIL", "pyarrow", "duckdb", "grpc", "nidaqmx", "nicegui", "rerun"),
    *("multiprocessing", "tomllib"),
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
