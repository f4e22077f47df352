"""Volts from an NI USB-6008 through nidaqmx: the load cell's amplifier and the 5 V sync line, in one task.

nidaqmx is used unchanged, with the local NI-DAQmx or an NI gRPC Device Server.
"""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import groupby
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from drivers.device import HostClock
from drivers.errors import DeviceCode, DeviceError, DeviceLost
from drivers.nidaq_session import OVERRUN, TIMED_OUT, DaqSession, ni_error_code, opening_error, streaming_error
from recordings.samples import DeviceIdentity, Item, Loss, Samples, Stream

CONNECT_TIMEOUT_S = 3.0
READS_PER_S = 20.0  # wall; NI advises about ten, each read is two round trips
LONGEST_WAIT_S = 1.0  # for samples, within one read
RPC_DEADLINE_S = LONGEST_WAIT_S + 1.0  # nidaqmx sets none: a frozen server would block the caller for ever
POSITION_LOOKS = 20  # one every 1 / READS_PER_S
BUFFER_S = 600.0  # device seconds that the PC buffer holds: 10 MB
LARGEST_READ_S = 10.0

T = TypeVar("T")
U = TypeVar("U")
Volts = NDArray[np.float64]  # (channels, n)


@dataclass(frozen=True)
class AnalogInput:
    """A differential input: the stream and the label under which it is recorded, its name on the device ("ai0"), and
    its range, ±range_v.
    """

    stream: str
    label: str
    channel: str
    range_v: float = 10.0

    def __str__(self) -> str:
        return f"{self.channel} (±{self.range_v:g} V)"


class NiDaq:
    """Streams in volts of analogue inputs, which one task converts at one rate.

    Inputs of one stream follow each other and become its columns.

    Sample numbers count from 0 at the start of the task; device time is number ÷ sample rate of the device. With start
    "pfi0" the task begins at the rising edge on PFI0, with "sync_edge" immediately. After an overrun the task is
    restarted, and the numbers jump by the samples missed according to the host's clock. After a lost connection the
    driver continues to read the task, which still runs in NI's server, with its own numbers; if the task is gone, a new
    one starts as after an overrun.
    """

    def __init__(
        self,
        *,
        device: str,
        inputs: Sequence[AnalogInput],
        sample_rate_hz: float,
        host_clock: HostClock,
        grpc_target: str | None = None,
        start: Literal["sync_edge", "pfi0"] = "sync_edge",
        timeout_scale: float = 1.0,
    ) -> None:
        self._device = device
        self._grpc_target = grpc_target
        self._inputs = tuple(inputs)
        self._rate_hz = float(sample_rate_hz)
        self._start = start
        self._timeout_scale = timeout_scale
        self._host_clock = host_clock
        self._vendor_errors: tuple[type[Exception], ...] = ()
        self._session: DaqSession | None = None
        self._task: Any = None
        self._reader: Any = None
        self._streams: tuple[Stream, ...] = ()
        self._identity = DeviceIdentity(self.name, "", None)
        self._next_number = 0
        self._start_number = 0  # of the task's sample 0
        self._is_started = False
        self._zero_ns = 0
        self._next_read_s = 0.0

    @property
    def name(self) -> str:
        return f"NI {self._device}"

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._streams

    @property
    def identity(self) -> DeviceIdentity:
        return self._identity

    def open(self) -> None:
        import grpc
        from nidaqmx.errors import Error

        self.close()
        # ValueError: gRPC's "closed channel", and NumPy's about a reply of the wrong length.
        self._vendor_errors = (Error, grpc.RpcError, ValueError, AssertionError)
        self._streams = ()
        self._next_number = 0
        self._zero_ns = sys.maxsize  # when sample 0 was taken, by the block that came with the least delay
        self._session = DaqSession(
            self._device,
            self._grpc_target,
            RPC_DEADLINE_S * self._timeout_scale,
            CONNECT_TIMEOUT_S * self._timeout_scale,
        )
        with contextlib.ExitStack() as undo:
            undo.callback(self.close)
            self._session.claim()
            self._connect_and(self._begin)
            undo.pop_all()

    def resume(self) -> None:
        session = self._opened
        self._task = self._reader = None
        session.disconnect()
        self._connect_and(self._continue_or_begin)

    def read(self, timeout_s: float) -> Sequence[Item]:
        task, reader = self._task, self._reader  # the watchdog may call close() meanwhile
        if task is None:
            raise DeviceLost(f"{self.name} is closed; open it before reading", DeviceCode.CLOSED)
        deadline_s = time.perf_counter() + min(timeout_s, LONGEST_WAIT_S)
        time.sleep(max(0.0, min(self._next_read_s, deadline_s) - time.perf_counter()))
        self._next_read_s = time.perf_counter() + 1 / READS_PER_S
        try:
            while not (volts := self._read_volts(task, reader, max(0.0, deadline_s - time.perf_counter()))).size:
                if time.perf_counter() >= deadline_s:
                    return []
                time.sleep(max(0.0, min(1 / READS_PER_S, deadline_s - time.perf_counter())))
            return self._samples(volts)
        except self._vendor_errors as error:
            if ni_error_code(error) in OVERRUN:
                return self._restart(task)
            raise self._lost(error) from error

    def close(self) -> None:
        """A task that cannot be reached stays in its server, and is cleared when the device is opened again."""
        session, task = self._session, self._task
        self._session = self._task = self._reader = None
        if session is None:
            return
        if task is not None:
            with contextlib.suppress(*self._vendor_errors):
                session.close(task)
        session.disconnect()
        session.release()

    @property
    def _opened(self) -> DaqSession:
        session = self._session  # the watchdog may call close() meanwhile
        if session is None:
            raise DeviceLost(f"{self.name} is closed; open it first", DeviceCode.CLOSED)
        return session

    def _connect_and(self, start: Callable[[DaqSession], None]) -> None:
        """Raises DeviceError."""
        session = self._opened
        try:
            session.connect()
            start(session)
        except self._vendor_errors as error:
            raise self._refusal(error) from error
        self._next_read_s = time.perf_counter()

    def _begin(self, session: DaqSession) -> None:
        """A new task, once the one that was left in the server is cleared."""
        self._is_started = False
        if (left := session.attach()) is not None:
            session.clear(left)
        self._task = task = session.create()
        self._configure(task)
        self._streams = self._streams or self._describe(session.options)
        task.start()
        self._count_missed(self._host_clock())
        self._start_number = self._next_number
        self._reports_available = self._ask(lambda: int(task.in_stream.avail_samp_per_chan), -1) >= 0
        self._is_started = True

    def _continue_or_begin(self, session: DaqSession) -> None:
        task = session.attach() if self._is_started and self._reports_available else None
        position = self._read_position(task) if task is not None else None
        if position is None or self._start_number + position < self._next_number:
            return self._begin(session)
        self._task, self._reader = task, _channel_reader(task)
        self._next_number = self._start_number + position
        return None

    def _read_position(self, task: Any) -> int | None:
        """Samples per channel read from the task, once no lost call is still reading; None if the task cannot be read
        further."""
        position = -1
        for _ in range(POSITION_LOOKS):
            before, position = position, self._ask(lambda: int(task.in_stream.curr_read_pos), -1)
            if position < 0:
                return None
            if position == before:
                return position
            time.sleep(1 / READS_PER_S)
        return None

    def _configure(self, task: Any) -> None:
        from nidaqmx.constants import AcquisitionType, Edge, TerminalConfiguration

        for one in self._inputs:
            task.ai_channels.add_ai_voltage_chan(
                f"{self._device}/{one.channel}",
                terminal_config=TerminalConfiguration.DIFF,
                min_val=-one.range_v,
                max_val=one.range_v,
            )
        task.timing.cfg_samp_clk_timing(
            self._rate_hz, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=int(BUFFER_S * self._rate_hz)
        )
        if self._start == "pfi0" and not self._has_begun:
            task.triggers.start_trigger.cfg_dig_edge_start_trig(f"/{self._device}/PFI0", trigger_edge=Edge.RISING)
        self._true_rate_hz = float(self._ask(lambda: task.timing.samp_clk_rate, 0.0)) or self._rate_hz
        self._reader = _channel_reader(task)
        self._block = max(1, round(self._true_rate_hz / READS_PER_S))
        self._buffer = np.empty(len(self._inputs) * max(1, int(LARGEST_READ_S * self._true_rate_hz)))

    def _describe(self, options: Any) -> tuple[Stream, ...]:
        from nidaqmx.system.device import Device

        device = Device(self._device, grpc_options=options)
        product = self._ask(lambda: str(device.product_type), "")
        serial_number = self._ask(lambda: f"{device.serial_num:08X}", "")  # as NI MAX prints it
        text = " ".join([*product.split(), *(["serial number", serial_number] if serial_number else [])])
        self._identity = DeviceIdentity(self.name, text, self._ask(lambda: bool(device.is_simulated), None))
        return tuple(
            Stream(
                name=stream,
                unit="V",
                labels=tuple(one.label for one in inputs),
                rate_hz=self._true_rate_hz,
                source=" ".join(["NI", *product.split(), f"{self._device}/{_channels(inputs)} at {self._where}"]),
                serial_number=serial_number,
            )
            for stream, inputs in self._by_stream()
        )

    def _by_stream(self) -> list[tuple[str, list[AnalogInput]]]:
        return [(name, list(inputs)) for name, inputs in groupby(self._inputs, key=lambda one: one.stream)]

    def _read_volts(self, task: Any, reader: Any, timeout_s: float) -> Volts:
        """All available samples, possibly none.

        Reads do not wait in the server: a reply that is lost with the connection would lose its samples. Only a server
        that does not report the number of available samples is asked to wait for the next block.
        """
        channels = len(self._inputs)
        if self._reports_available:
            available = int(task.in_stream.avail_samp_per_chan)
            if not available:
                return self._buffer[:0].reshape(channels, 0)
        else:
            available = self._due(self._host_clock()) - self._next_number
        count = min(available if available > 0 else self._block, self._buffer.size // channels)
        volts = self._buffer[: channels * count].reshape(channels, count)
        try:
            reader.read_many_sample(volts, count, timeout=timeout_s)
        except self._vendor_errors as error:
            if ni_error_code(error) != TIMED_OUT:
                raise
            volts = volts[:, : getattr(error, "samps_per_chan_read", 0)]
        return volts

    def _samples(self, volts: Volts) -> list[Item]:
        host_time_ns = self._host_clock()
        numbers = self._next_number + np.arange(volts.shape[1], dtype=np.uint64)
        device_time_ns = np.rint(numbers * (1e9 / self._true_rate_hz)).astype(np.int64)
        self._next_number += volts.shape[1]
        self._zero_ns = min(self._zero_ns, host_time_ns - int(device_time_ns[-1]))
        ends = np.cumsum([len(stream.labels) for stream in self._streams])
        return [
            Samples(stream.name, numbers, device_time_ns, host_time_ns, rows.T.copy())
            for stream, rows in zip(self._streams, np.split(volts, ends[:-1]), strict=True)
        ]

    def _restart(self, task: Any) -> list[Item]:
        """After an overrun: free-running again, one Loss per stream for what fell between the two runs."""
        try:
            task.stop()
            if self._start == "pfi0":
                task.triggers.start_trigger.disable_start_trig()  # its edge is past
            task.start()
        except self._vendor_errors as error:
            raise self._lost(error) from error
        host_time_ns = self._host_clock()
        first_missing = self._next_number
        count = self._count_missed(host_time_ns)
        self._start_number = self._next_number
        last_device_time_ns = round(max(first_missing - 1, 0) * 1e9 / self._true_rate_hz)
        return [
            Loss(stream.name, "overrun", first_missing, count, last_device_time_ns, host_time_ns)
            for stream in self._streams
            if count
        ]

    @property
    def _has_begun(self) -> bool:
        """Whether samples have been received, so that the trigger, if there is one, is past."""
        return self._next_number > 0

    def _due(self, host_time_ns: int) -> int:
        """Number of samples the device has taken since sample 0, by the host's clock; never more than it has."""
        return int((host_time_ns - self._zero_ns) * 1e-9 * self._true_rate_hz)

    def _count_missed(self, host_time_ns: int) -> int:
        """Skip the sample numbers that a task starting now has missed; returns their count."""
        count = max(1, self._due(host_time_ns) - self._next_number) if self._has_begun else 0
        self._next_number += count
        return count

    def _ask(self, question: Callable[[], T], otherwise: U) -> T | U:
        """Answer to an optional query; `otherwise` if the device does not support it."""
        try:
            return question()
        except self._vendor_errors:
            return otherwise

    def _refusal(self, error: Exception) -> DeviceError:
        """The error of device, driver or server at opening, as one sentence."""
        asked = f"{' and '.join(map(str, self._inputs))} at {self._rate_hz:g} Hz each with start {self._start}"
        return opening_error(error, self.name, self._where, asked)

    def _lost(self, error: Exception) -> DeviceLost:
        return streaming_error(error, f"{self.name} at {self._where}")

    @property
    def _where(self) -> str:
        return self._grpc_target or "the local NI-DAQmx"


def _channels(inputs: Sequence[AnalogInput]) -> str:
    return ", ".join(one.channel for one in inputs)


def _channel_reader(task: Any) -> Any:
    from nidaqmx.stream_readers import AnalogMultiChannelReader

    reader = AnalogMultiChannelReader(task.in_stream)
    reader.verify_array_shape = False  # costs a round trip per read
    return reader
