"""A console in a process of its own, for tests that look at it from outside."""

import os
import socket
import subprocess
import sys
from collections.abc import Sequence
from inspect import getsource
from pathlib import Path
from typing import Self

from station.child import ProcessLink
from tests.timeout import scaled_timeout

CONFIG = """
[daq]
grpc_target = "127.0.0.1:{ni}"

[mocap]
port = {qtm}
control = "start"

[protocol]
repeats = 1
hold_s = {hold_s}
step_masses_kg = [2.0, 2.0, 2.0]

[session]
folder = "{sessions}"

[cuffs.hand]
anchor_markers = ["anchor_1", "anchor_2", "anchor_3", "anchor_4"]
cuff_markers = ["cuff_1"]
rope_markers = ["rope_1", "rope_2"]

[simulation.protocol.static]
step_masses_kg = [2.0, 2.0, 2.0]

[simulation.protocol.dynamic]
swing_s = {swing_s}

[simulation.cuffs.hand]
stiffness_n_per_m = 8520
damping_n_s_per_m = 210
migration_m = {migration_m}
"""


def write_config(
    folder: Path,
    *,
    migration_m: float = 0.012,
    hold_s: float = 7.0,
    swing_s: float = 12.0,
    ni: int = 9,
    qtm: int = 9,
    sessions: str = "sessions",
) -> Path:
    """A station.toml with its devices at these ports of this machine; sessions go into the folder it is used in."""
    path = folder / "station.toml"
    path.write_text(
        CONFIG.format(migration_m=migration_m, hold_s=hold_s, swing_s=swing_s, ni=ni, qtm=qtm, sessions=sessions)
    )
    return path


def be_patient() -> None:
    """In the process of a console: it takes presses however late, and keeps connections to a browser that is held up.

    A busy machine delays both by seconds. A page would be loaded anew, without what was just typed.
    """
    from nicegui import app, core

    from station.console import actions

    actions.LATE_S = 600.0
    app.on_startup(lambda: setattr(core.sio.eio, "ping_timeout", 600.0))


def main(parent: ProcessLink, folder: str, port: str) -> None:
    """The live page alone, as a child of the test."""
    from station.console import server

    be_patient()
    server.main(parent, folder, port)


class ServedConsole:
    """A context manager; the console ends with it."""

    python = sys.executable  # pytest --served-by replaces it

    def __init__(
        self,
        config: Path,
        *options: str,
        port: int = 0,
        program: Sequence[str] = ("-c", f"{getsource(be_patient)}\nbe_patient()\nfrom station.cli import main; main()"),
    ) -> None:
        self._config, self._options, self._program = config, options, program
        self.address, self.port = "", port
        self._child: subprocess.Popen[str] | None = None

    def __enter__(self) -> Self:
        if not self.port:
            with socket.socket() as free:
                free.bind(("127.0.0.1", 0))
                self.port = free.getsockname()[1]
        words = ["serve", "--config", str(self._config), "--port", str(self.port), *self._options]
        self._child = subprocess.Popen(  # noqa: S603  (our own words)
            [self.python, *self._program, *words],
            stdout=subprocess.PIPE,
            text=True,
            cwd=self._config.parent,
            env={name: value for name, value in os.environ.items() if not name.startswith("PYTEST")},
        )
        assert self._child.stdout is not None
        self.address = self._child.stdout.readline().strip()
        if not self.address.startswith("http://127.0.0.1:"):
            self.close()
            raise AssertionError("the console printed no address")
        return self

    @property
    def pid(self) -> int:
        assert self._child is not None
        return self._child.pid

    def kill(self) -> None:
        """As a power cut would."""
        assert self._child is not None
        self._child.kill()
        self._child.wait()

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        if self._child is not None:
            if self.python == sys.executable:
                self._child.terminate()
            else:  # a process of Windows takes no signals
                self._child.kill()
            try:
                self._child.wait(scaled_timeout(20.0))
            except subprocess.TimeoutExpired:
                self.kill()
            if self._child.stdout is not None:
                self._child.stdout.close()
