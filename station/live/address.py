"""Where the live process of a session is reached: a file in the session's folder that its owner alone may read.

On Windows it has the permissions of the folder.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

from documents.plain_data import PlainDataError, parse_json
from documents.regular_file import describe_failure, read_regular
from station.messages.live_codes import LiveCode
from station.messages.message import Message

ADDRESS_FILE = ".live.json"
LARGEST = 4096  # bytes


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
    """None where no live process has announced itself; one that was killed leaves an address that refuses.

    A file that is no announcement is ignored, and named on stderr once.
    """
    path = folder / ADDRESS_FILE
    try:
        found = parse_json(read_regular(path, LARGEST))
    except FileNotFoundError:
        return None
    except (OSError, PlainDataError) as error:
        return _ignored(path, describe_failure(error))
    port, token = (found.get("port"), found.get("token")) if isinstance(found, dict) else (None, None)
    if isinstance(port, int) and 0 < port < 65536 and isinstance(token, str):
        return LiveAddress(port, token)
    return _ignored(path, "it has no port from 1 to 65535 with a token")


@cache
def _ignored(path: Path, reason: str) -> None:
    print(Message(LiveCode.WRONG_ADDRESS, {"path": str(path), "reason": reason}), file=sys.stderr, flush=True)
