"""Sessions of NI-DAQmx: a task on this computer, or in a named session of an NI gRPC Device Server.

Such a server keeps a session, and its task keeps the device, until the task is cleared or the device is reset; the
death of a client ends nothing (ni/grpc-device, source/server/session_repository.cpp). Our session therefore has a name,
which is noted on this computer until its task is cleared, so that the next program can attach to a task left behind.

Errors of NI-DAQmx, of its gRPC server and of the transport become sentences for the operator.
"""

from __future__ import annotations

import contextlib
import re
import time
import uuid
from collections.abc import Callable
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from drivers.errors import DeviceCode, DeviceError, DeviceLost, DeviceMisconfigured, DeviceUnavailable

FOLDER = ".cuffstation"
"""In the user's home: the note of each device's session. A restart of this computer may empty a folder for temporary
files while the server continues to run."""

LONGEST_ROUND_TRIP = 0.1
"""Of one call, as a fraction of the time-out for connecting (0.3 s of 3 s): opening takes forty calls in a row, and the
check of the bench waits 15 s for its devices."""
ROUND_TRIPS = 3  # the fastest counts: a busy machine may delay one

NOTED_NAME = re.compile(r"cuffstation_[0-9a-f]{32}")
LONGEST_NOTE = 64  # characters; reading a device file would not end
# nidaqmx.error_codes.DAQmxErrors
TIMED_OUT = -200284
OVERRUN = {-200279, -200222, -200361, -200004}  # PC buffer or on-board FIFO overwritten: a restart cures it
NO_SUCH_DEVICE = {-200220, -201003, -200045}
IN_USE = {-200022, -50103}
NO_SUCH_CHANNEL = {-200170}
NO_TRANSFER = {-50405}  # of the USB-600x, after minutes or hours; only unplugging it helps

UNAVAILABLE = (
    (NO_SUCH_DEVICE, DeviceCode.NOT_FOUND, "was not found", "plug it in, or correct daq.device"),
    (
        IN_USE,
        DeviceCode.IN_USE,
        "is in use by another program",
        "close that program; if none is running, restart NI's device server to clear the task of a program that died",
    ),
    (NO_TRANSFER, DeviceCode.NO_TRANSFER, "transfers no samples", "unplug it and plug it in again"),
)
"""NI's error codes → our code, what happened, what to do."""


class SessionClaim:
    """The right of one program on this computer to our session for a device.

    The operating system releases the lock of a program that dies. The holder of the lock may clear the task of the
    noted name; sessions of other computers and programs have other names and are never touched.
    """

    def __init__(self, server: str, device: str) -> None:
        self._owner = f"NI {device} at {server}"
        key = re.sub(r"[^A-Za-z0-9.]", "_", f"daq_{server}_{device}")
        self._folder = Path.home() / FOLDER
        self._note = self._folder / f"{key}.session"
        self._lock = FileLock(self._folder / f"{key}.lock", timeout=0, thread_local=False)
        self.name = ""

    def acquire(self) -> None:
        """Raises DeviceUnavailable if another program on this computer holds it."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._lock.acquire()
            self.name = self._noted_name() or f"cuffstation_{uuid.uuid4().hex}"
        except Timeout as error:
            raise DeviceUnavailable(
                f"{self._owner} is in use by another recording on this computer; wait until it has ended, or end it",
                DeviceCode.IN_USE,
            ) from error
        except (OSError, NotImplementedError) as error:
            raise DeviceUnavailable(
                f"{self._owner}: no file can be locked in {self._folder} ({error}); make this folder writable",
                DeviceCode.NOT_LOCKED,
            ) from error

    def note(self) -> None:
        """Call before a session of this name is created."""
        with contextlib.suppress(OSError):  # a full disk is reported by the recording itself
            self._note.unlink(missing_ok=True)  # never write through a link of this name
            with self._note.open("x", encoding="ascii") as note:
                note.write(self.name)

    def erase(self) -> None:
        """Call when the session is closed."""
        with contextlib.suppress(OSError):
            self._note.unlink(missing_ok=True)

    def release(self) -> None:
        """Release the lock. The note of a session that was not closed stays."""
        if self._lock.is_locked:
            with contextlib.suppress(OSError):  # Windows deletes no file that is open
                Path(self._lock.lock_file).unlink(missing_ok=True)
            self._lock.release()

    def _noted_name(self) -> str:
        if not self._note.is_file():  # opening a pipe would wait for its writer
            return ""
        try:
            with self._note.open(encoding="ascii") as note:
                name = note.read(LONGEST_NOTE)
        except (FileNotFoundError, ValueError):
            return ""
        return name if NOTED_NAME.fullmatch(name) else ""


class DaqSession:
    """Creates tasks on one device; target None is the local NI-DAQmx, which ends the tasks of a dead program itself.

    Every call to a server ends within deadline_s wall seconds, the value when it begins. Methods raise the errors of
    nidaqmx and grpc, and DeviceUnavailable.
    """

    def __init__(self, device: str, target: str | None, deadline_s: float, connect_timeout_s: float) -> None:
        self._device, self._target = device, target
        self.deadline_s, self._connect_timeout_s = deadline_s, connect_timeout_s
        self._is_near = False
        self._claim = SessionClaim(target, device) if target else None
        self._channel: Any = None
        self._local_task: Any = None

    def claim(self) -> None:
        """Raises DeviceUnavailable if another program on this computer uses the device through the server."""
        if self._claim is not None:
            self._claim.acquire()

    def connect(self) -> None:
        """Raises DeviceUnavailable if no server answers or, the first time, if the network is too slow."""
        if self._target is None:
            return
        import grpc

        self._channel = _channel_with_deadline(self._target, lambda: self.deadline_s)
        try:
            grpc.channel_ready_future(self._channel).result(timeout=self._connect_timeout_s)
        except grpc.FutureTimeoutError as error:
            raise DeviceUnavailable(
                f"NI {self._device} expected an NI gRPC device server at {self._target}, and none answered within "
                f"{self._connect_timeout_s:g} s; start it, or correct daq.grpc_target",
                DeviceCode.NO_SERVER,
            ) from error
        fastest_s = 0.0 if self._is_near else min(_round_trip_s(self._channel) for _ in range(ROUND_TRIPS))
        if fastest_s > (longest_s := LONGEST_ROUND_TRIP * self._connect_timeout_s):
            raise DeviceUnavailable(
                f"NI {self._device} at {self._target} takes {fastest_s:.1f} s to answer a call, expected at most "
                f"{longest_s:.1f} s; the network is too slow: connect the two computers by cable, without Wi-Fi or VPN",
                DeviceCode.NETWORK_TOO_SLOW,
            )
        self._is_near = True

    @property
    def options(self) -> Any:
        """Session options of nidaqmx for all calls except those of our task; None for the local driver."""
        import nidaqmx

        return None if self._channel is None else nidaqmx.GrpcSessionOptions(self._channel, "")

    def attach(self) -> Any:
        """The task that this program, or one that died, left in the server; None without one."""
        import grpc
        from nidaqmx import SessionInitializationBehavior
        from nidaqmx.errors import RpcError

        try:
            return self._task(SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION) if self._claim else None
        except RpcError as error:
            if error.rpc_code != grpc.StatusCode.FAILED_PRECONDITION:
                raise
            return None

    def create(self) -> Any:
        from nidaqmx import SessionInitializationBehavior
        from nidaqmx.task import Task

        if self._claim is None:
            self._local_task = Task()
            return self._local_task
        self._claim.note()
        return self._task(SessionInitializationBehavior.INITIALIZE_SERVER_SESSION)

    def close(self, task: Any) -> None:
        """End the task of this session."""
        self._local_task = None
        task.close()
        if self._claim is not None:
            self._claim.erase()

    def clear(self, task: Any) -> None:
        """End a task that was attached to.

        If NI-DAQmx cannot clear it and it was acquiring, the device is reset: while our task acquired, no other program
        could use the device. A device that is in use for any other reason is never reset.
        """
        from nidaqmx.errors import DaqError
        from nidaqmx.system.device import Device

        was_acquiring = _is_acquiring(task)
        try:
            task.close()
        except DaqError:
            if was_acquiring:
                Device(self._device, grpc_options=self.options).reset_device()

    def disconnect(self) -> None:
        """Close the channel. A session in the server stays as it is; a task of the local driver ends."""
        from nidaqmx.errors import Error

        task, self._local_task = self._local_task, None
        if task is not None:
            with contextlib.suppress(Error):
                task.close()
        channel, self._channel = self._channel, None
        if channel is not None:
            channel.close()

    def release(self) -> None:
        if self._claim is not None:
            self._claim.release()

    def _task(self, behavior: Any) -> Any:
        from nidaqmx import GrpcSessionOptions
        from nidaqmx.task import Task

        name = self._claim.name if self._claim else ""
        options = GrpcSessionOptions(self._channel, name, initialization_behavior=behavior)
        return Task(name, grpc_options=options)


def _is_acquiring(task: Any) -> bool:
    """Whether samples have come from the task and it has not ended."""
    from nidaqmx.errors import Error

    try:
        return not task.is_task_done() and task.in_stream.total_samp_per_chan_acquired > 0
    except Error:
        return False


def _round_trip_s(channel: Any) -> float:
    """Wall seconds of one call without effect; raises grpc.RpcError if it is not answered."""
    import grpc

    call = channel.unary_unary("/nidaqmx_grpc.NiDAQmx/GetSystemInfoAttributeUInt32")
    begun_s = time.perf_counter()
    try:
        call(b"")
    except grpc.RpcError as error:  # a refusal is an answer, too
        answer: Any = error
        if answer.code() in (grpc.StatusCode.DEADLINE_EXCEEDED, grpc.StatusCode.UNAVAILABLE):
            raise
    return time.perf_counter() - begun_s


def _channel_with_deadline(target: str, deadline_s: Callable[[], float]) -> Any:
    """A gRPC channel on which every call ends within the seconds that deadline_s returns at its begin."""
    import grpc

    class Deadline(grpc.UnaryUnaryClientInterceptor):
        def intercept_unary_unary(self, continuation: Any, client_call_details: Any, request: Any) -> Any:
            return continuation(client_call_details._replace(timeout=deadline_s()), request)

    # A proxy named in the environment would be asked for the loopback address, too.
    channel = grpc.insecure_channel(target, options=[("grpc.enable_http_proxy", 0)])
    return grpc.intercept_channel(channel, Deadline())


def ni_error_code(error: BaseException | None) -> int:
    """NI's error code; 0 for errors of the transport."""
    return int(getattr(error, "error_code", 0))


def opening_error(error: Exception, device: str, where: str, asked: str) -> DeviceError:
    """The error at opening; asked names the inputs with their ranges, the rate and the start that were asked for."""
    from nidaqmx.errors import DaqNotFoundError

    code, who = ni_error_code(error), f"{device} at {where}"
    if isinstance(error, DaqNotFoundError):
        return DeviceUnavailable(
            f"{device} needs the NI-DAQmx driver, and this computer has none; "
            "install it, or set daq.grpc_target to an NI gRPC device server",
            DeviceCode.NO_DRIVER,
        )
    for codes, reason, what, advice in UNAVAILABLE:
        if code in codes:
            return DeviceUnavailable(f"{who} {what} (NI error {code}); {advice}", reason)
    if code in NO_SUCH_CHANNEL:
        return DeviceMisconfigured(
            f"{who} was asked for the differential inputs {asked} and lacks one of them (NI error {code}); "
            "correct daq.force_channel, daq.sync_channel or the inputs of [emg] and [analog]",
            DeviceCode.NO_CHANNEL,
        )
    if code < 0:
        return DeviceMisconfigured(
            f"{who} was asked for {asked}, and refused: {_error_text(error)} (NI error {code}); correct the [daq] "
            "section",
            DeviceCode.REFUSED,
        )
    sentence = f"{who}: expected an answer of NI-DAQmx, found {_error_text(error)}; restart its server"
    return DeviceUnavailable(sentence, DeviceCode.NO_ANSWER)


def streaming_error(error: Exception, who: str) -> DeviceLost:
    """The error of a device that was streaming."""
    code = ni_error_code(error)
    advice = "unplug it and plug it in again" if code in NO_TRANSFER else "check its cable and its server"
    shown = f" (NI error {code})" if code else ""
    return DeviceLost(f"{who} stopped streaming: {_error_text(error)}{shown}; {advice}", DeviceCode.DISCONNECTED)


def _error_text(error: Exception) -> str:
    """Error text of NI or gRPC on one line, without code and task name."""
    is_grpc = callable(getattr(error, "details", None))  # an error of gRPC itself, which nidaqmx passes on
    text = f"{error.code().name}: {error.details()}" if is_grpc else str(error)  # type: ignore[attr-defined]
    text = re.split(r"\n\s*(?:Task Name|Status Code):", text)[0].removeprefix("StatusCode.")
    if text.startswith("DEADLINE_EXCEEDED"):
        return "no answer in time"
    return " ".join(text.split()).rstrip(".")[:300] or type(error).__name__
