"""Write the example configuration and the examples into a folder of the user."""

from __future__ import annotations

import shutil
from importlib.metadata import files
from pathlib import Path

from documents.message import Message
from documents.regular_file import replaced
from station.errors import StationError
from station.messages.setup_messages import ConfigCode

SHARED = "share/cuffstation/"
"""Folder of the example files in an installation."""


class InitError(StationError):
    """The folder already has one of the files."""


def write_examples(folder: Path) -> list[Path]:
    """Copy station.toml and examples/ into the folder; returns station.toml and examples. Raises InitError, OSError."""
    sources = _sources()
    if existing := [name for name in sources if (folder / name).exists()]:
        raise InitError(Message(ConfigCode.EXISTS, {"file": str(folder / existing[0])}))
    for name, source in sources.items():
        with replaced(folder / name) as draft:
            shutil.copyfile(source, draft)
    return [folder / "station.toml", folder / "examples"]


def _sources() -> dict[str, Path]:
    """Path in the user's folder → file of the checkout or of the installation."""
    checkout = Path(__file__).parents[2]
    if (checkout / "station.toml").is_file():
        files_in = [checkout / "station.toml", *sorted((checkout / "examples").rglob("*.*"))]
        found = {path.relative_to(checkout).as_posix(): path for path in files_in}
    else:
        found = {file.as_posix().partition(SHARED)[2]: Path(str(file.locate())) for file in files("cuffstation") or ()}
    return {name: path for name, path in found.items() if name and not name.endswith(".pyc")}  # pip compiles scripts
