"""One trial's life: idle → armed → recording → closing → closed | failed.

Knows no thread and no device: it is handed what devices delivered and told that time has passed, so every
path through it can be walked by a test with a clock that stands still.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Literal, Protocol

from fitting.timing.sync_line import BOUNCE
from recordings.samples import Event, Item, Loss, Samples, Stream
from station.bench.falls import ALREADY_CAPTURING, ARMED, Falls
from station.bench.first_frame import FirstFrame
from station.bench.overload import Overload
from station.bench.pre_roll import LATENESS_S, PRE_ROLL_S, PreRoll
from station.bench.shortfall import SHORT_S, Shortfall
from station.bench.stream_watchdog import SILENCE_TIMEOUT_S, StreamWatchdog
from station.bench.sync_line import GLITCH_NS, Edge, SyncLine, wrong_polarity
from station.clock import Clock

POST_ROLL_S = 0.5
"""Station seconds recorded after the capture's end, so that the sync line's falling edge is in the file."""
QUIET_S = 1.0
"""Station seconds without frames after which, with the sync line low, the capture is over; and without samples after
which closing waits no longer for the post-roll. For the capture's own it waits as long as for any that fall silent."""
LONGEST_CLOSING_S = 15.0
"""Station seconds after which closing waits no longer at all, though a backlog still comes in."""


class TrialState(Enum):
    IDLE = "idle"
    ARMED = "armed"
    RECORDING = "recording"
    CLOSING = "closing"
    CLOSED = "closed"
    FAILED = "failed"


class ItemWriter(Protocol):
    """What a trial needs of the writer; every method raises RecordingError once the first write has failed."""

    def write(self, item: Item) -> None: ...

    def flush_if_due(self) -> None: ...


@dataclass(frozen=True)
class TrialRules:
    """What this trial waits for. Times in station seconds; duration None: until the capture ends."""

    start: Literal["sync_edge", "pfi0"]
    threshold_v: float
    timeout_s: float
    duration_s: float | None
    post_roll_s: float = POST_ROLL_S


@dataclass(frozen=True)
class Snapshot:
    """The trial at a moment, for views. left_s: station seconds until an armed trial gives up; 0 in other states.

    edge_device_ns is the sync edge by the clock of /sync, None before it.
    """

    state: TrialState
    sentence: str
    sync_level_v: float | None = None
    waited_s: float = 0.0
    recorded_s: float = 0.0
    lost_samples: int = 0
    marks: int = 0
    streams: tuple[Stream, ...] = ()
    left_s: float = 0.0
    edge_device_ns: int | None = None


class TrialStateMachine:
    """The state machine. Terminal states are CLOSED (accepted) and FAILED; `sentence` says why.

    has_edge tells whether anything worth keeping was recorded.
    """

    def __init__(self, rules: TrialRules, recorder: ItemWriter, clock: Clock) -> None:
        self.state = TrialState.IDLE
        self.sentence = "idle"
        self.has_edge = False
        self.lost_samples = 0
        self.marks = 0
        self.wants_capture_start = False
        self._rules = rules
        self._recorder = recorder
        self._clock = clock
        self._sync = SyncLine(rules.threshold_v)
        self._pre_roll = PreRoll()
        self._streams: tuple[Stream, ...] = ()
        self._watchdog = StreamWatchdog(clock, (), {})
        self._shortfall = Shortfall((), self._watchdog)
        self._first_frame = FirstFrame(())
        self._armed_s = 0.0
        self._edge_device_ns = self._latest_device_ns = 0
        self._edge_s = 0.0
        self._falls = Falls()
        self._dip: Edge | None = None  # the latest fall while recording
        self._notes: list[Event] = []
        self._overload = Overload()
        self._doubt = ""  # why the trial will not be accepted, though it goes on
        self._has_capture_ended = False
        self._closing_host_ns, self._closing_s, self._closing_ok = 0, 0.0, True

    @property
    def is_over(self) -> bool:
        return self.state in (TrialState.CLOSED, TrialState.FAILED)

    def snapshot(self) -> Snapshot:
        waited = self._clock.station_s() - self._armed_s if self.state is TrialState.ARMED else 0.0
        recorded = max(0, self._latest_device_ns - self._edge_device_ns) * 1e-9 if self.has_edge else 0.0
        return Snapshot(
            self.state,
            self.sentence,
            self._sync.level_v,
            waited,
            recorded,
            self.lost_samples,
            self.marks,
            self._streams,
            max(0.0, self._rules.timeout_s - waited) if self.state is TrialState.ARMED else 0.0,
            self._edge_device_ns if self.has_edge else None,
        )

    def arm(self, streams: Sequence[Stream], device_of: Mapping[str, str] | None = None) -> None:
        """All devices are open: from now on what comes is kept, and the edge is waited for.

        device_of names the device of each stream by its name.
        """
        self._streams = tuple(streams)
        self._watchdog = StreamWatchdog(self._clock, streams, device_of or {})
        self._shortfall = Shortfall(streams, self._watchdog)
        self._armed_s = self._clock.station_s()
        self._first_frame = FirstFrame(streams)
        self._enter(TrialState.ARMED, ARMED)
        self._record(self._event("armed", "all devices are open; waiting for the sync edge"))

    def handle(self, item: Item) -> None:
        """Takes one item from a device, in the order of arrival."""
        if self.state not in (
            TrialState.ARMED,
            TrialState.RECORDING,
            TrialState.CLOSING,
        ) or self._is_of_another_capture(item):
            return
        if isinstance(item, Samples) and len(item.device_time_ns):
            self._watchdog.record_arrival(item.stream)
            self._shortfall.feed(item)
            if item.stream == "/markers":
                self._lose(self._first_frame.feed(item))
        elif isinstance(item, Loss):
            self.lost_samples += item.count if self.has_edge else 0
        self._record(item)
        if self.has_edge and (words := self._overload.feed(item, self._clock.utc_ns())):
            self._record(self._event("overloaded", words))
        if isinstance(item, Event):
            self._follow_capture(item)
            self._watchdog.handle_event(item)
            self._first_frame.follow(item)
        elif isinstance(item, Samples) and item.stream == "/sync":
            self._follow_sync(item)

    def tick(self) -> None:
        """Time has passed: time-outs, silent streams, the end of closing, flushing. To be called all the time."""
        paused_s = self._watchdog.poll()
        if paused_s is not None and self.state in (TrialState.ARMED, TrialState.RECORDING, TrialState.CLOSING):
            words = f"the station itself stood still for {paused_s:.1f} s; see that its computer does not sleep or swap"
            self._record(self._event("station_paused", words))
        if self.state is TrialState.ARMED:
            self._check_armed()
        elif self.state is TrialState.RECORDING:
            self._check_silence(("/force", "/sync", "/markers"), self._edge_s)
            self._check_quiet_capture_end()
        elif self.state is TrialState.CLOSING:
            self._check_closing()
        self._recorder.flush_if_due()

    def stop(self, at_once: bool = False) -> None:
        """The operator's wish. While armed it cancels; while recording it closes the trial and keeps it."""
        if self.state in (TrialState.IDLE, TrialState.ARMED):
            self._enter(TrialState.FAILED, "cancelled by the operator before the sync edge; nothing was recorded")
        elif self.state is TrialState.RECORDING:
            self._close("operator_stop", "stopped by the operator", accepted=True)
        if at_once and self.state is TrialState.CLOSING:
            self._finish()

    def mark(self) -> None:
        """The operator points at this moment, to be named later; before the edge there is nothing to point at."""
        if self.state in (TrialState.RECORDING, TrialState.CLOSING):
            self.marks += 1
            self._record(self._event("mark", f"mark {self.marks}"))

    def note(self, kind: str, words: str) -> None:
        """What the operator should know of the armed trial: an event at its edge, and a part of its last sentence."""
        self._notes.append(self._event(kind, words))

    def fail(self, sentence: str, device: str = "", cause: str = "disconnected") -> None:
        """A device is gone: the trial ends here. One that goes while the trial is closing takes nothing with it."""
        if self.state is TrialState.RECORDING:
            self._watchdog.mark_lost(device, cause)
            self._close("device_lost", sentence, accepted=False)
            self._finish()
        elif self.state in (TrialState.IDLE, TrialState.ARMED):
            self._enter(TrialState.FAILED, sentence)

    def cut_short(self, kind: str, sentence: str) -> None:
        """The trial cannot go on: what was recorded is closed well and kept, and not accepted."""
        if self.state is TrialState.RECORDING:
            self._close(kind, sentence, accepted=False)
        elif self.state in (TrialState.IDLE, TrialState.ARMED):
            self._enter(TrialState.FAILED, sentence)

    def abandon(self, sentence: str) -> None:
        """The recorder failed: nothing more can be written."""
        self._enter(TrialState.FAILED, sentence)

    # -- armed ---------------------------------------------------------------------------------------------------

    def _check_armed(self) -> None:
        waited = self._clock.station_s() - self._armed_s
        if self._rules.start == "sync_edge":
            self._check_silence(("/sync",), self._armed_s)
            self._check_polarity()
            self.wants_capture_start = waited >= PRE_ROLL_S and self._watchdog.last_arrival_s("/sync") is not None
        else:
            self.wants_capture_start = True
        if self.state is TrialState.ARMED and waited > self._rules.timeout_s:
            why = self._sync.why_no_rise(self._falls.unexplained)
            self._enter(TrialState.FAILED, f"no sync edge came within {self._rules.timeout_s:g} s{why}")

    def _follow_sync(self, samples: Samples) -> None:
        if not len(samples.device_time_ns):
            return
        self._latest_device_ns = int(samples.device_time_ns[-1])
        if self.state is TrialState.ARMED and self._rules.start == "pfi0":
            first = int(samples.sample_numbers[0]), int(samples.device_time_ns[0])
            self._begin(*first, "the hardware trigger on PFI0 started the acquisition")
        for edge in self._sync.feed(samples):
            if edge.is_glitch:
                self._note_glitch(edge)
            elif self.state is TrialState.ARMED:
                self._look_for_start(edge)
            elif self.state is TrialState.RECORDING:
                self._look_for_second_start(edge)
        if self.state is TrialState.RECORDING and self._rules.duration_s is not None:
            recorded_s = (self._latest_device_ns - self._edge_device_ns) * 1e-9
            if recorded_s >= self._rules.duration_s:
                self._close("duration_reached", f"{self._rules.duration_s:g} s recorded after the edge", accepted=True)
                self._closing_host_ns = self._shortfall.reached_ns("/sync")

    def _look_for_start(self, edge: Edge) -> None:
        if edge.rising:
            words = f"the sync line rose from {edge.from_v:z.2f} V to {edge.to_v:z.2f} V"
            self._begin(edge.sample_number, edge.device_time_ns, words)
        else:
            self._armed_s = self._clock.station_s()  # an earlier capture ended: the wait begins anew
            self._falls.note_fall(edge, self._armed_s)
            self._pre_roll.forget_before(edge.device_time_ns)

    def _note_glitch(self, glitch: Edge) -> None:
        words = f"the sync line {'spiked' if glitch.rising else 'dipped'} to {glitch.to_v:z.2f} V"
        at = f"for less than {GLITCH_NS * 1e-6:g} ms at sample {glitch.sample_number}"
        self._record(self._event("sync_glitch", f"{words} {at}, which starts nothing and ends nothing"))

    def _check_polarity(self) -> None:
        """A fall together with the start of a capture is an inverted line; a fall alone ends an earlier capture."""
        if edge := self._falls.inverted_start(self._clock.station_s()):
            self._enter(TrialState.FAILED, wrong_polarity(edge))
        elif self.state is TrialState.ARMED:
            self.sentence = ALREADY_CAPTURING if self._sync.is_high else ARMED

    def _begin(self, sample_number: int, device_time_ns: int, words: str) -> None:
        self.has_edge = True
        self._edge_device_ns, self._edge_s = device_time_ns, self._clock.station_s()
        self._enter(TrialState.RECORDING, "recording")
        for item in [*self._pre_roll.cut(device_time_ns), *self._notes]:
            self._recorder.write(item)
        self._record(self._event("sync_edge", f"{words} at sample {sample_number}; recording"))
        since_edge_ns = self._latest_device_ns - device_time_ns
        self._lose(self._first_frame.edge(self._shortfall.reached_ns("/sync") - since_edge_ns))

    # -- recording and closing -----------------------------------------------------------------------------------

    def _look_for_second_start(self, edge: Edge) -> None:
        """A line that comes up once more leaves two starts to choose from: the trial goes on, and will not count."""
        if not edge.rising:
            self._dip = edge
        elif self._dip is not None and edge.device_time_ns - self._dip.device_time_ns >= BOUNCE * 1e9:
            after_s = (edge.device_time_ns - self._edge_device_ns) * 1e-9
            self._doubt = (
                f"the sync line rose a second time {after_s:.2f} s after the first, so nobody knows which of them is "
                "the capture's start; set the mocap system's output to one pulse for the whole capture and record again"
            )
            self.sentence = f"recording; {self._doubt}"
            self._record(self._event("sync_double_edge", self._doubt))

    def _follow_capture(self, event: Event) -> None:
        if self.state is TrialState.ARMED:
            self._falls.note_capture(event.kind, self._clock.station_s())
            if event.kind in ("capture_stopped", "numbering_restarted", "capture_replaced"):
                self._pre_roll.forget_frames()
        elif event.kind == "capture_stopped" and self.state is TrialState.RECORDING:
            self._note_empty_capture()
            self._close("capture_ended", "the mocap capture ended", accepted=True)
        elif event.kind == "capture_replaced":
            self.cut_short(event.kind, event.text)
        elif event.kind == "numbering_restarted" and self._recorded_s > LATENESS_S:
            self._close("capture_ended", "the mocap system numbers its frames anew: its capture ended", accepted=True)

    def _is_of_another_capture(self, item: Item) -> bool:
        """Frames that come after our capture's end are a preview's, or the next one's."""
        return self._has_capture_ended and isinstance(item, Samples | Loss) and item.stream == "/markers"

    @property
    def _recorded_s(self) -> float:
        """Station seconds since the edge; 0 unless the trial is recording."""
        return self._clock.station_s() - self._edge_s if self.state is TrialState.RECORDING else 0.0

    def _check_silence(self, expected: Sequence[str], since_s: float) -> None:
        silent = self._watchdog.find_silent_stream(expected, since_s)
        if silent is not None:
            stream = silent.stream
            lost = f"{stream.source} sent nothing on {stream.name} for {silent.silence_s:.1f} s"
            why = f"{lost}, expected {stream.rate_hz:g} samples a second; check the device and its cable"
            self.fail(why, self._watchdog.device_of(stream.name), "silent")

    def _lose(self, loss: Loss | None) -> None:
        """Counts and records what the station itself found missing, if anything."""
        if loss is not None:
            self.lost_samples += loss.count
            self._record(loss)

    def _note_empty_capture(self) -> None:
        """One that ends before its silence had lasted long enough to be noticed."""
        markers = next((stream for stream in self._streams if stream.name == "/markers"), None)
        if markers is not None and (self._watchdog.last_arrival_s(markers.name) or 0.0) < self._edge_s:
            missing = round(self._recorded_s * markers.rate_hz)
            self._lose(Loss(markers.name, "silent", 0, missing, self._latest_device_ns, self._clock.utc_ns()))
            self._doubt = f"{markers.source} sent not one frame of it; check that it tracks and streams 3D in real time"

    def _check_quiet_capture_end(self) -> None:
        """A mocap system that sends no events ends its capture by a low sync line and no more frames."""
        last = self._watchdog.last_arrival_s("/markers")
        quiet = last is not None and self._clock.station_s() - last > QUIET_S
        if self.state is TrialState.RECORDING and quiet and self._rules.start == "sync_edge" and not self._sync.is_high:
            self._close("capture_ended", "the sync line is low and the frames ended", accepted=True)

    def _close(self, kind: str, sentence: str, accepted: bool) -> None:
        self._closing_ok = accepted and not self._doubt
        sentence = f"{sentence}; {self._doubt}" if self._doubt else sentence
        self._has_capture_ended = kind in ("capture_ended", "capture_replaced")
        self._closing_host_ns, self._closing_s = self._clock.utc_ns(), self._clock.station_s()
        self._enter(TrialState.CLOSING, sentence)
        self._record(self._event(kind, sentence))

    def _check_closing(self) -> None:
        """Waits for the DAQ's samples up to the capture's end and a little more; a backlog may take its time."""
        behind = self._shortfall.behind(self._closing_host_ns, -self._rules.post_roll_s)
        now = self._clock.station_s()
        heard = max([self._closing_s, *(self._watchdog.last_arrival_s(stream.name) or 0.0 for stream, _ in behind)])
        short = [(stream, short_s) for stream, short_s in behind if short_s > SHORT_S]
        patience_s = SILENCE_TIMEOUT_S if short else QUIET_S
        if behind and now - heard < patience_s and now - self._closing_s < LONGEST_CLOSING_S:
            return
        for stream, short_s in short:
            self._closing_ok = False
            self.sentence = f"{stream.source} sent nothing on {stream.name} in the last {short_s:.1f} s of the trial"
        self._finish()

    def _finish(self) -> None:
        for loss in self._shortfall.losses(self._closing_host_ns, self._closing_s, self._edge_s):
            self._lose(loss)
        if self._has_capture_ended and self._sync.is_high:
            words = "the sync line is still high where the recording ends, so the start edge alone ties the clocks"
            self._record(self._event("no_stop_edge", words))
            self.sentence += f"; {words}"
        notes = [note.text for note in self._notes]
        self.sentence = "; ".join(filter(None, [self.sentence, *notes, self._overload.sentence]))
        self._enter(TrialState.CLOSED if self._closing_ok else TrialState.FAILED, self.sentence)

    def _enter(self, state: TrialState, sentence: str) -> None:
        self.state, self.sentence = state, sentence

    def _record(self, item: Item) -> None:
        if self.state is TrialState.ARMED:
            self._pre_roll.keep(item)
        else:
            self._recorder.write(item)

    def _event(self, kind: str, text: str) -> Event:
        return Event(kind, text, self._clock.utc_ns(), "station")
