"""Where the live process of a session is reached: a file in the session's folder that its owner alone may read."""

from __future__ import annotations

import json
import os
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

ADDRESS_FILE = ".live.json"


@dataclass(frozen=True)
class LiveAddress:
    """Port on 127.0.0.1. token must be sent first: the port is open to every user of this computer."""

    port: int
    token: str


def announce(folder: Path, address: LiveAddress) -> None:
    path = folder / ADDRESS_FILE
    path.unlink(missing_ok=True)
    with os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w", encoding="utf-8") as file:
        json.dump(asdict(address), file)


def withdraw(folder: Path, address: LiveAddress) -> None:
    """Remove the announcement, if it is still the one of this address."""
    if find_address(folder) == address:
        with suppress(OSError):
            (folder / ADDRESS_FILE).unlink(missing_ok=True)


def find_address(folder: Path) -> LiveAddress | None:
    """None where no live process has announced itself; one that was killed leaves an address that refuses."""
    try:
        found = json.loads((folder / ADDRESS_FILE).read_text(encoding="utf-8"))
        return LiveAddress(int(found["port"]), str(found["token"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
