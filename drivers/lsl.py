"""EMG from an outlet of the Lab Streaming Layer (LSL), through pylsl.

The wire carries a time stamp of the sender's clock for each sample and no number. LSL measures the offset between that
clock and this computer's; the offsets are recorded beside the samples, and the stamps stay as they were sent.
"""

from __future__ import annotations

import contextlib
import ctypes
import math
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from documents.interval import counted
from drivers.device import TOLERANCE_S, DeviceClock, HostClock
from drivers.errors import DeviceCode, DeviceLost, DeviceMisconfigured, DeviceUnavailable, one_line
from recordings.samples import DeviceIdentity, Event, Item, Loss, Samples, Stream

RESOLVE_TIMEOUT_S = 5.0
TWIN_TIMEOUT_S = 1.0  # for a second outlet of the same name: in a network with two benches either may answer first
CONNECT_TIMEOUT_S = 3.0  # for the description, the stream and the first clock offset, each
READS_PER_S = 20.0  # wall
WAKE_S = 0.01
GAP_S = 0.1  # outlets stamp by the chunk, with a jitter of tens of milliseconds; a longer jump of the stamps is a loss
FAST = 0.01  # by which an amplifier may be faster than its nominal rate
FURTHEST_S = 4e9  # of a stamp from 0: a time in UTC until 2096, and in nanoseconds within 64 bits
CLOCK_INTERVAL_S = 2.0  # LSL's own between two measurements of the offset
MOST_SAMPLES = 4096  # of one call
UNITS = {
    **dict.fromkeys(("v", "volt", "volts"), "V"),
    **dict.fromkeys(("mv", "millivolt", "millivolts"), "mV"),
    **dict.fromkeys(("uv", "µv", "μv", "microvolt", "microvolts"), "uV"),
}
UNKNOWN_UNIT = "unknown"


class LslEmg:
    """Stream /emg, /emg_sync where sync_channel is named, and /emg_clock: clock offsets in seconds.

    channels maps the names in the recording to the labels of the outlet; empty: all but sync_channel, as labelled.
    Sample numbers count from 0 in the order of arrival; device time is the stamp. If the stamps jump forward by more
    than GAP_S, the numbers jump by the samples that are missing at the nominal rate, and a Loss reports them. If they
    jump ahead of this computer's clock, or back, the event "emg_clock_reset" reports a jump of the sender's clock, and
    the numbers continue. A stamp that is no time is interpolated ("emg_clock_unreadable"). After a
    lost connection the numbers jump without a Loss. /emg_clock has one sample every CLOCK_INTERVAL_S; its device time
    is the reading of the sender's clock at its host time.
    """

    def __init__(
        self,
        *,
        stream: str,
        host_clock: HostClock,
        channels: Mapping[str, str] | None = None,
        sync_channel: str = "",
        unit: str | None = None,
        timeout_scale: float = 1.0,
    ) -> None:
        """unit replaces the one that the outlet declares."""
        self._stream, self._channels, self._sync_channel, self._unit = stream, dict(channels or {}), sync_channel, unit
        self._host_clock, self._timeout_scale = host_clock, timeout_scale
        self._pylsl: Any = None
        self._vendor_errors: tuple[type[Exception], ...] = ()
        self._inlet: Any = None
        self._next_read_s = self._next_clock_s = 0.0  # wall
        self._streams: tuple[Stream, ...] = ()
        self._identity = DeviceIdentity(self.name, "", None)

    @property
    def name(self) -> str:
        return f"LSL {self._stream}"

    @property
    def streams(self) -> tuple[Stream, ...]:
        return self._streams

    @property
    def identity(self) -> DeviceIdentity:
        return self._identity

    def open(self) -> None:
        self.close()
        self._next_number = self._next_clock_number = 0
        self._first: tuple[int, int] | None = None  # host time and count of the first samples
        self._last: tuple[float, int] | None = None  # stamp and host time of the last sample
        self._was_away = False
        self._clock = DeviceClock()
        with contextlib.ExitStack() as undo:
            undo.callback(self.close)
            info = self._connect()
            self._describe(info)
            undo.pop_all()

    def resume(self) -> None:
        self.close()
        with contextlib.ExitStack() as undo:
            undo.callback(self.close)
            info = self._connect()
            if info.nominal_srate() != self._rate_hz or self._channel_labels(info) != self._labels:
                sentence = f"{self.name} reconnected with other channels or another sample rate; start a new trial"
                raise DeviceMisconfigured(sentence, DeviceCode.CHANGED)
            undo.pop_all()
        self._was_away = True

    def read(self, timeout_s: float) -> Sequence[Item]:
        inlet = self._inlet  # the watchdog may call close() meanwhile
        if inlet is None:
            raise DeviceLost(f"{self.name} is closed; open it before reading", DeviceCode.CLOSED)
        deadline_s = time.perf_counter() + timeout_s
        time.sleep(max(0.0, min(self._next_read_s, deadline_s) - time.perf_counter()))
        self._next_read_s = time.perf_counter() + 1 / READS_PER_S
        try:
            while True:
                values, stamps = inlet.pull_chunk(0.0, MOST_SAMPLES, as_numpy=True)
                if len(stamps) or time.perf_counter() >= deadline_s:
                    items = self._items(values.astype(np.float64), stamps)
                    return [*items, *self._clock_offset(inlet)] if items else []
                time.sleep(max(0.0, min(WAKE_S, deadline_s - time.perf_counter())))
        except self._vendor_errors as error:
            sentence = f"{self.name} stopped streaming: {one_line(error)}; check the amplifier's program"
            raise DeviceLost(sentence, DeviceCode.DISCONNECTED) from error

    def close(self) -> None:
        inlet, self._inlet = self._inlet, None
        if inlet is not None:
            with contextlib.suppress(*self._vendor_errors):
                inlet.close_stream()

    def _connect(self) -> Any:
        """Connect; returns the outlet's full description once samples flow and the clock offset is known.

        Raises DeviceError.
        """
        try:
            import pylsl
        except ModuleNotFoundError as error:
            sentence = f"{self.name} needs the package pylsl, which is not installed; pip install pylsl"
            raise DeviceUnavailable(sentence, DeviceCode.NO_DRIVER) from error
        except RuntimeError as error:  # its library was not found
            sentence = f"{self.name} needs liblsl, which cannot be loaded: {one_line(error)}; install liblsl"
            raise DeviceUnavailable(sentence, DeviceCode.NO_DRIVER) from error
        self._pylsl, self._vendor_errors = pylsl, (RuntimeError, ValueError)  # LostError and TimeoutError are the first
        found = pylsl.resolve_byprop("name", self._stream, 2, TWIN_TIMEOUT_S) or pylsl.resolve_byprop(
            "name", self._stream, 1, RESOLVE_TIMEOUT_S * self._timeout_scale
        )
        if not found:
            raise DeviceUnavailable(
                f"{self.name} was not found: no outlet of this name answered within {RESOLVE_TIMEOUT_S:g} s; start the "
                "amplifier's program or correct emg.stream, and let LSL (UDP 16571, TCP 16572 to 16604) through the "
                "firewall",
                DeviceCode.NOT_FOUND,
            )
        if len({info.uid() for info in found}) > 1:
            hosts = ", ".join(sorted(info.hostname() for info in found))
            sentence = f"{self.name} is the name of {len(found)} outlets, on {hosts}; stop all but one"
            raise DeviceMisconfigured(sentence, DeviceCode.SEVERAL_OUTLETS)
        timeout_s = CONNECT_TIMEOUT_S * self._timeout_scale
        try:
            inlet = pylsl.StreamInlet(found[0], recover=False, processing_flags=pylsl.proc_none)
            info = inlet.info(timeout_s)
            self._refuse_no_signal(info)
            inlet.open_stream(timeout_s)
            inlet.time_correction(timeout_s)
        except self._vendor_errors as error:
            raise DeviceUnavailable(
                f"{self.name} was found and does not stream: {one_line(error)}; restart its program",
                DeviceCode.NO_ANSWER,
            ) from error
        self._inlet, self._next_read_s = inlet, time.perf_counter()
        return info

    def _refuse_no_signal(self, info: Any) -> None:
        is_text = info.channel_format() == self._pylsl.cf_string
        if is_text or info.nominal_srate() <= 0:
            what = "text" if is_text else "samples at no regular rate"
            raise DeviceMisconfigured(
                f"{self.name} sends {what}, expected numbers at a regular rate; set emg.stream to the EMG outlet",
                DeviceCode.NO_SIGNAL,
            )

    def _describe(self, info: Any) -> None:
        self._rate_hz, self._labels = float(info.nominal_srate()), self._channel_labels(info)
        wanted = self._channels or {label: label for label in self._labels if label != self._sync_channel}
        missing = [label for label in (*wanted.values(), self._sync_channel) if label and label not in self._labels]
        if missing:
            raise DeviceMisconfigured(
                f"{self.name} has no channel {', '.join(missing)}, only {', '.join(self._labels)}; correct the [emg] "
                "section",
                DeviceCode.NO_CHANNEL,
            )
        self._columns = [self._labels.index(label) for label in wanted.values()]
        units = dict(zip(self._labels, info.get_channel_units() or [""] * len(self._labels), strict=False))
        unit = self._unit or self._common_unit([units[label] for label in wanted.values()])
        clock_hz = 1 / CLOCK_INTERVAL_S
        described = [("/emg", unit, tuple(wanted), self._rate_hz)]
        if self._sync_channel:
            described.append(("/emg_sync", _unit_name(units[self._sync_channel]), (self._sync_channel,), self._rate_hz))
        described.append(("/emg_clock", "s", ("offset", "uncertainty"), clock_hz))
        source, serial_number = f"LSL outlet {self._stream} at {info.hostname()}", info.source_id() or ""
        self._streams = tuple(Stream(*stream, source, serial_number) for stream in described)
        maker = " ".join(filter(None, (_text(info, key) for key in ("manufacturer", "model", "serial_number"))))
        self._identity = DeviceIdentity(self.name, maker or info.type(), False if maker else None)

    def _channel_labels(self, info: Any) -> tuple[str, ...]:
        labels = info.get_channel_labels() or []
        count = info.channel_count()
        return tuple((labels[i] if i < len(labels) else None) or f"channel_{i + 1}" for i in range(count))

    def _common_unit(self, units: Sequence[str | None]) -> str:
        found = {_unit_name(unit) for unit in units}
        if len(found) > 1:
            raise DeviceMisconfigured(
                f"{self.name} has channels in {', '.join(sorted(found))}, expected one unit for all; list those of one "
                "unit under [emg.channels]",
                DeviceCode.MIXED_UNITS,
            )
        return found.pop()

    def _items(self, values: NDArray[np.float64], stamps: NDArray[np.float64]) -> list[Item]:
        """Blocks of consecutive samples, a Loss for each gap between them, and an Event if the sender's clock jumps."""
        if not len(stamps):
            return []
        host_time_ns = self._host_clock()
        stamps, items = self._sound_stamps(stamps, host_time_ns)
        before = stamps[0] - 1 / self._rate_hz if self._last is None else self._last[0]
        steps = np.diff(stamps, prepend=before)
        self._first = self._first or (host_time_ns, len(stamps))
        first, clock_steps = 0, list[float]()
        for place in np.flatnonzero(
            (np.abs(steps) > GAP_S) | (self._was_away & (np.arange(len(stamps)) == 0))
        ).tolist():
            self._follow(stamps[first:place], host_time_ns)
            is_of_clock = steps[place] <= 0 or not self._clock.is_possible(float(stamps[place]), host_time_ns)
            number = self._next_number + place - first + float(steps[place]) * self._rate_hz
            is_of_clock |= number > self._most_samples(host_time_ns)
            if is_of_clock:
                self._clock.restart()
            if is_of_clock and not self._was_away:
                clock_steps.append(float(steps[place]))
                continue
            items += self._block(values[first:place], stamps[first:place], host_time_ns)
            items += self._gap(float(steps[place]), float(stamps[place]), host_time_ns, is_of_clock=is_of_clock)
            first = place
        items += self._block(values[first:], stamps[first:], host_time_ns)
        self._follow(stamps, host_time_ns)
        self._last = float(stamps[-1]), host_time_ns
        return [*self._clock_event(clock_steps, host_time_ns), *items]

    def _sound_stamps(self, stamps: NDArray[np.float64], host_time_ns: int) -> tuple[NDArray[np.float64], list[Item]]:
        """The stamps, interpolated where they are not times, and the Event that reports it."""
        is_sound = np.isfinite(stamps) & (np.abs(stamps) < FURTHEST_S)
        if is_sound.all():
            return stamps, []
        place, first = np.arange(len(stamps)), int(is_sound.argmax())
        start_s = stamps[first] - (first + 1) / self._rate_hz if is_sound.any() else host_time_ns * 1e-9
        start_s = start_s if self._last is None else self._last[0]
        latest = np.maximum.accumulate(np.where(is_sound, place, -1))
        filled = np.where(latest < 0, start_s, stamps[latest]) + (place - latest) / self._rate_hz
        wrong = stamps[~is_sound]
        text = (
            f"{self.name} stamped {counted(len(wrong), 'sample')} with {wrong[0]:g} s, which is no "
            "time; theirs is interpolated"
        )
        return filled, [Event("emg_clock_unreadable", text, host_time_ns, self.name)]

    def _most_samples(self, host_time_ns: int) -> float:
        """Most that can have been sent by now: stamps that creep ahead stay below the limit of a jump."""
        first_ns, count = self._first or (host_time_ns, 0)
        since_s = (host_time_ns - first_ns) * 1e-9
        return count + ((1 + FAST) * since_s + TOLERANCE_S) * self._rate_hz

    def _follow(self, stamps: NDArray[np.float64], host_time_ns: int) -> None:
        if len(stamps):
            self._clock.add(float(stamps[-1]), host_time_ns)

    def _gap(self, step_s: float, stamp: float, host_time_ns: int, *, is_of_clock: bool) -> list[Item]:
        """Advance the sample numbers by those that are missing, and return a Loss of every stream.

        After an outage there is no Loss; the clock of a restarted sender may start again, and the host's clock counts.
        """
        was_away, self._was_away = self._was_away, False
        if was_away and self._last is not None:
            away_s = (host_time_ns - self._last[1]) * 1e-9 if is_of_clock else step_s
            self._next_number += max(1, round(away_s * self._rate_hz) - 1)
            return []
        missing = round(step_s * self._rate_hz) - 1
        if missing < 1:
            return []
        first, self._next_number = self._next_number, self._next_number + missing
        last_ns = round(1e9 * (stamp - step_s))
        names = [stream.name for stream in self._streams if stream.name != "/emg_clock"]
        return [Loss(name, "skipped", first, missing, last_ns, host_time_ns) for name in names]

    def _clock_event(self, steps: Sequence[float], host_time_ns: int) -> list[Item]:
        """The Event of jumps of the sender's clock."""
        if not steps:
            return []
        largest = max(steps, key=abs)
        count = f"{len(steps)} times, at most " if len(steps) > 1 else ""
        direction = "ahead" if largest > 0 else "back"
        text = (
            f"{self.name} set its clock {count}{direction} by {abs(largest):.1f} s; later stamps are by the new clock"
        )
        return [Event("emg_clock_reset", text, host_time_ns, self.name)]

    def _block(self, values: NDArray[np.float64], stamps: NDArray[np.float64], host_time_ns: int) -> list[Item]:
        if not len(stamps):
            return []
        numbers = self._next_number + np.arange(len(stamps), dtype=np.uint64)
        self._next_number += len(stamps)
        times_ns = np.rint(1e9 * stamps).astype(np.int64)
        items: list[Item] = [Samples("/emg", numbers, times_ns, host_time_ns, values[:, self._columns].copy())]
        if self._sync_channel:
            pulse = values[:, [self._labels.index(self._sync_channel)]].copy()
            items.append(Samples("/emg_sync", numbers, times_ns, host_time_ns, pulse))
        return items

    def _clock_offset(self, inlet: Any) -> list[Item]:
        """Every CLOCK_INTERVAL_S one sample of /emg_clock; none from a silent sender."""
        if time.perf_counter() < self._next_clock_s:
            return []
        self._next_clock_s = time.perf_counter() + CLOCK_INTERVAL_S
        offset_s, uncertainty_s = _time_correction(inlet, CONNECT_TIMEOUT_S)
        here_s, host_time_ns = self._pylsl.local_clock(), self._host_clock()
        if not (math.isfinite(uncertainty_s) and abs(here_s - offset_s) < FURTHEST_S):
            return []
        number = np.array([self._next_clock_number], np.uint64)
        self._next_clock_number += 1
        there_ns = np.array([round(1e9 * (here_s - offset_s))], np.int64)
        return [Samples("/emg_clock", number, there_ns, host_time_ns, np.array([[offset_s, uncertainty_s]]))]


def _time_correction(inlet: Any, timeout_s: float) -> tuple[float, float]:
    """Offset [s] that takes the sender's clock to this computer's, and its uncertainty [s], by half a round trip.

    pylsl has no method for the second, which liblsl's lsl_time_correction_ex gives.
    """
    from pylsl.lib import lib
    from pylsl.util import handle_error

    remote, uncertainty, code = ctypes.c_double(), ctypes.c_double(), ctypes.c_int()
    lib.lsl_time_correction_ex.restype = ctypes.c_double
    offset = lib.lsl_time_correction_ex(
        inlet.obj, ctypes.byref(remote), ctypes.byref(uncertainty), ctypes.c_double(timeout_s), ctypes.byref(code)
    )
    handle_error(code)
    return float(offset), float(uncertainty.value)


def _unit_name(text: str | None) -> str:
    return UNITS.get((text or "").strip().lower(), (text or "").strip() or UNKNOWN_UNIT)


def _text(info: Any, key: str) -> str:
    """An entry of "acquisition" in the description, as in the XDF specification of metadata."""
    return str(info.desc().child("acquisition").child_value(key) or "")
