"""The link between the station and its child processes: messages both ways, over a pipe that only the two have.

Child("station.live.process") runs main(link) of that module in a new process. The child inherits one end of a pipe (a
socket pair, on Windows a named pipe), so it has no name, port or key for which another program could ask. The end of
one process closes its end, at which the other one stops receiving at once; a suspended process closes nothing. No child
reads a standard handle: on Windows a pending read blocks every other call on the handle, such as the queries of NumPy's
libraries while they load.

A message is an object of JSON, or bytes. One thread of a process receives; any thread may send. A link is closed after
the other process has ended, because a receiving thread would keep it open.
"""

from __future__ import annotations

import gc
import importlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import suppress
from multiprocessing import connection
from pathlib import Path
from typing import Any, NoReturn

from station.end_signals import end_signals

DETACHED: dict[str, Any] = (
    {"creationflags": 0x0800_0000 | 0x0000_0200}  # CREATE_NO_WINDOW and CREATE_NEW_PROCESS_GROUP
    if sys.platform == "win32"
    else {"start_new_session": True}
)
"""Options of a child that outlives its terminal: Ctrl-C, Ctrl-Break and closing end the session, and not a trial."""


class ProcessLink:
    """One end of the pipe. send() blocks while the other process does not receive; raises OSError once it has ended."""

    def __init__(self, end: Any) -> None:
        self._end = end
        self._sending = threading.Lock()

    def send(self, message: dict[str, Any]) -> None:
        self.send_bytes(json.dumps(message, allow_nan=False).encode())

    def send_bytes(self, message: bytes) -> None:
        with self._sending:
            self._end.send_bytes(message)

    def receive(self) -> dict[str, Any] | None:
        """The next message; None once the other process has ended."""
        data = self.receive_bytes()
        message: dict[str, Any] | None = None if data is None else json.loads(data)
        return message

    def receive_bytes(self) -> bytes | None:
        """The same for bytes; a message that was cut by the end is left out."""
        with suppress(EOFError, OSError):
            return bytes(self._end.recv_bytes())
        return None

    def __iter__(self) -> Iterator[dict[str, Any]]:
        """Messages until the other process ends."""
        return iter(self.receive, None)  # type: ignore[return-value, unused-ignore]

    def close(self) -> None:
        self._end.close()


class Child(ProcessLink):
    """A new process that runs main(link, *arguments) of a module. Raises OSError if it cannot be started.

    It has no standard input, and no standard output unless the options, those of Popen, have one.
    """

    def __init__(self, module: str, *arguments: str, **options: Any) -> None:
        ours, theirs = connection.Pipe()
        super().__init__(ours)
        try:
            self.process = subprocess.Popen(  # noqa: S603  (our own modules)
                # -P: a solver.py in the user's folder must not be imported in place of our package
                [sys.executable, "-P", "-m", "station.child", str(theirs.fileno()), module, *arguments],
                stdin=subprocess.DEVNULL,
                **{"stdout": subprocess.DEVNULL, **_inherit(theirs.fileno()), **options},
            )
        except BaseException:
            ours.close()
            raise
        finally:
            theirs.close()  # ours then ends with the child

    def ensure_ended(self, timeout_s: float = 0.0) -> int:
        """Kill the process if it still runs after the time-out; close the link. Returns the exit code."""
        try:
            code = self.process.wait(timeout_s)
        except subprocess.TimeoutExpired:
            self.process.kill()
            code = self.process.wait()
        self.close()
        return code

    def leave(self) -> None:
        """Close the link, and leave the process to end by itself."""
        self.close()
        threading.Thread(target=self.process.wait, name="a process that outlives us", daemon=True).start()


def exit_at_once(code: int) -> NoReturn:
    """End this process without waiting for threads, and on Windows for libraries, which can block or fail at their end.

    os._exit runs their code for the end of a process there, after it has killed the threads in which they work.
    """
    if sys.platform == "win32":
        import _winapi

        _winapi.TerminateProcess(_winapi.GetCurrentProcess(), code)
    os._exit(code)


def exit_with_parent(link: ProcessLink) -> None:
    """End this process at once when its parent ends, which sends nothing more."""

    def wait() -> None:
        link.receive_bytes()
        exit_at_once(1)

    threading.Thread(target=wait, name="parent", daemon=True).start()


def _inherit(handle: int) -> dict[str, Any]:
    """Options of Popen by which the child inherits this handle and no other."""
    if sys.platform != "win32":
        return {"pass_fds": (handle,)}
    os.set_handle_inheritable(handle, True)  # noqa: FBT003
    return {"startupinfo": subprocess.STARTUPINFO(lpAttributeList={"handle_list": [handle]})}


def _inherited_link(handle: int) -> ProcessLink:
    if sys.platform == "win32":
        os.set_handle_inheritable(handle, False)  # noqa: FBT003
        return ProcessLink(connection.PipeConnection(handle))
    os.set_inheritable(handle, False)  # noqa: FBT003  (by position only)
    return ProcessLink(connection.Connection(handle))


def main() -> None:
    """Run a module as the child, with the link that was inherited."""
    for number in end_signals():
        if number != signal.SIGTERM:  # keys and windows of a terminal reach all its processes; the parent decides
            signal.signal(number, signal.SIG_IGN)
    try:
        handle, module, *arguments = sys.argv[1:]
        link = _inherited_link(int(handle))
    except (ValueError, OSError):
        sys.exit("station.child is started by the station, with an inherited pipe; run `station --help`.")
    sys.path.append(str(Path(__file__).parents[1]))  # a checkout, whose tests have children, too
    gc.disable()  # what is imported stays: looking for garbage takes a tenth of the start
    imported = importlib.import_module(module)
    gc.enable()
    sys.exit(imported.main(link, *arguments))


if __name__ == "__main__":
    main()
