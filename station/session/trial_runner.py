"""The trial that runs in its own process: start, marks, stop, result; and as views show it: curves, cue, alarm.

Limits of force and force rate hold for a cuff that a person wears; exceeding one raises an alarm. At a simulated bench,
the instructions of the guide are carried out by themselves.
"""

from __future__ import annotations

import asyncio
import math
import threading
from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import CancelledError, Future
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from itertools import chain
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from pydantic import TypeAdapter, ValidationError

from documents.message import Message
from documents.validation import describe_error
from station.bench.simulation import SimulatedBench, SimulationError
from station.bench.view import TrialTelemetry
from station.child import DETACHED, Child
from station.config import StationConfig
from station.journal import JournalError, Recorded, write_mark
from station.messages.bench_messages import AlarmCode, RefusalCode, TrialCode
from station.messages.session_messages import CommandCode
from station.protocol import BODY_TESTS, TrialSpec
from station.session.guide import Cue, Guide, guide_for, wearer_guide
from station.session.open_session import CommandRefused, OpenSession
from station.session.plan_status import PlanStatus
from station.session.trial_daemon import TrialRequest

KEPT_POINTS = 1600
"""Points of each live curve: half a minute."""
TARE_S = 1.0
RATE_SPAN_S = (0.05, 0.2)
"""Distance in time of the two points that give a force rate."""
END_TIMEOUT_S = 10.0
"""Wall seconds for a recorder to end after it has closed its link."""
_RECORDED = TypeAdapter(Recorded)


@dataclass
class LiveTrial:
    """The running trial: its last telemetry, the curves since its start, and what the operator did."""

    spec: TrialSpec
    guide: Guide
    latest: TrialTelemetry = field(default_factory=TrialTelemetry)
    force: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    displacement: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    elevation: deque[tuple[float, float]] = field(default_factory=lambda: deque(maxlen=KEPT_POINTS))
    emg: dict[str, deque[tuple[float, float]]] = field(default_factory=dict)  # RMS [µV], by channel
    mvc_uv: Mapping[str, float] = field(default_factory=dict)  # largest RMS of each channel in the MVC trial
    events: deque[str] = field(default_factory=lambda: deque(maxlen=8))
    unread: Message[RefusalCode] | None = None  # on the last message of the recorder that cannot be read
    alarm: Message[AlarmCode] | None = None
    is_alarm_seen: bool = False
    marks: dict[int, float] = field(default_factory=dict)  # s into the recording, by the number of the mark
    mark_names: dict[int, str] = field(default_factory=dict)
    tare_n: float | None = None

    @property
    def is_of_wearer(self) -> bool:
        """Whether it is a pose or a motion, guided and drawn by the elevation of the arm."""
        return self.spec.test in BODY_TESTS

    @property
    def motion(self) -> deque[tuple[float, float]]:
        """Elevation of the wearer's arm [deg] or displacement of the cuff [mm]."""
        return self.elevation if self.is_of_wearer else self.displacement

    @property
    def shown_emg(self) -> dict[str, list[tuple[float, float]]]:
        """RMS over time [% of its MVC] of every channel that has one; without an MVC trial [µV] of all."""
        shown = self.mvc_uv or self.emg
        return {
            channel: [(t, uv / self.mvc_uv[channel] * 100 if self.mvc_uv else uv) for t, uv in points]
            for channel, points in self.emg.items()
            if channel in shown
        }

    @property
    def cue(self) -> Cue:
        return self.guide.cue()

    def from_edge(self, points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
        """Points of a curve with their time from the sync edge; before it, from now."""
        kept = list(points)
        edge_s = self.latest.edge_s
        zero_s = kept[-1][0] if edge_s is None and kept else edge_s or 0.0
        return [(round(t - zero_s, 4), value) for t, value in kept]

    @property
    def unseen_alarm(self) -> Message[AlarmCode] | None:
        return None if self.is_alarm_seen else self.alarm

    @property
    def takes_marks(self) -> bool:
        """Marks refer to the recording, which begins at the sync edge."""
        return self.latest.state in ("recording", "closing")

    def add_mark(self, name: str = "") -> int:
        """Add a mark at this moment and return its number."""
        number = len(self.marks) + 1
        self.marks[number] = self.latest.recorded_s
        if name:
            self.mark_names[number] = name
        return number

    def tare(self) -> None:
        """Count the net force from the mean of the last second; the recording keeps the raw force."""
        if self.force:
            recent = [force for time, force in self.force if time > self.force[-1][0] - TARE_S]
            self.tare_n = sum(recent) / len(recent)

    def update(self, telemetry: TrialTelemetry, limits: ForceLimits) -> bool:
        """Take one message of the recorder. Returns whether it raised an alarm."""
        self.latest = telemetry
        force = telemetry.force
        self.force.extend(force)
        self.displacement.extend(telemetry.displacement)
        self.elevation.extend(telemetry.elevation)
        for channel, rms_uv in telemetry.emg_uv.items() if self.force else ():
            self.emg.setdefault(channel, deque(maxlen=KEPT_POINTS)).append((self.force[-1][0], rms_uv))
        self.events.extend(telemetry.events)
        if telemetry.state in ("armed", "recording"):
            points = telemetry.elevation if self.is_of_wearer else force
            self.guide.update(points, is_recorded=telemetry.state == "recording")
        return self._update_alarm(limits.check(list(self.force)[-8 - len(force) :]))

    def _update_alarm(self, alarm: Message[AlarmCode] | None) -> bool:
        """An alarm stays until the operator has seen it and its cause is gone; then it may be raised again."""
        is_new = alarm is not None and self.alarm is None
        if is_new:
            self.alarm = alarm
        elif alarm is None and self.is_alarm_seen:
            self.alarm, self.is_alarm_seen = None, False
        return is_new


@dataclass(frozen=True)
class ForceLimits:
    """Newtons, and newtons per second over a tenth of a second.

    capacity_n is that of the load cell: beyond it, in either direction, its calibration may be lost.
    """

    force_n: float
    rate_n_per_s: float
    capacity_n: float = math.inf

    def check(self, points: Sequence[tuple[float, float]]) -> Message[AlarmCode] | None:
        """The alarm for the first (time s, newtons) beyond a limit; None if there is none."""
        for time, force in points:
            if abs(force) > self.capacity_n:
                return Message(AlarmCode.OVERLOAD, {"force_n": force, "capacity_n": self.capacity_n})
            if force > self.force_n:
                return Message(AlarmCode.FORCE, {"force_n": force, "limit_n": self.force_n})
            before = [earlier for earlier in points if RATE_SPAN_S[0] <= time - earlier[0] <= RATE_SPAN_S[1]]
            if before and (force - before[-1][1]) / (time - before[-1][0]) > self.rate_n_per_s:
                return Message(AlarmCode.FORCE_RATE, {"limit_n_per_s": self.rate_n_per_s})
        return None


def force_limits(config: StationConfig) -> ForceLimits:
    cell = config.load_cell
    return ForceLimits(config.force_ceiling_n, config.safety.force_rate_ceiling_n_per_s, cell.capacity_n)


class TrialRunner:
    """Methods raise CommandRefused, JournalError and SimulationError.

    live is the running trial; ended is the previous one, with its result or refusal.
    """

    def __init__(self, session: OpenSession, bench: SimulatedBench | None) -> None:
        self._session = session
        self.live: LiveTrial | None = None
        self.ended: TrialProcess | None = None
        self.limits = force_limits(session.config)
        self._trial: TrialProcess | None = None
        self._tasks: set[asyncio.Task[None]] = set()
        self._operator = SimulatedOperator(bench, session.config.protocol.pause_s) if bench is not None else None

    async def arm(self) -> None:
        """Start the recorder for the next trial of the plan."""
        self._session.refuse_while_running()
        self._session.ensure_readable()
        plan = self._session.plan
        if plan is None or self._session.folder is None:
            raise CommandRefused.of(CommandCode.NO_SESSION)
        spec = self._session.next_spec(plan)
        self._session.message, self._session.judgement = "", None
        self.live = LiveTrial(spec, _guide(spec, self._session.trial_config), mvc_uv=self._session.mvc_uv)
        self._session.has_running_trial = True
        try:
            if self._operator is not None:
                await _in_daemon_thread(self._operator.prepare, plan)
            self._trial = await TrialProcess.start(
                self._session.trial_config, self._session.folder, spec, self._session.clock_port, self._session.speed
            )
        except BaseException:
            self.live, self._session.has_running_trial = None, False
            raise
        self._spawn(self._follow(self._trial))

    async def stop(self) -> None:
        """End the trial: cleanly at the first call, at once at the second. An armed trial is cancelled."""
        if self._trial is None:
            raise CommandRefused.of(CommandCode.NO_TRIAL)
        self._trial.stop()

    async def end_early(self) -> None:
        """End the session with the trials so far; a running trial is ended cleanly first, and its recording counts."""
        if self._session.folder is None:
            raise CommandRefused.of(CommandCode.NO_SESSION)
        self._session.is_ending = True
        if self._trial is not None:
            self._trial.stop()

    async def mark(self) -> int:
        """Mark this moment in the recording; returns the number of the mark, by which it is named later."""
        if self._trial is None or self.live is None:
            raise CommandRefused.of(CommandCode.NO_TRIAL)
        if not self.live.takes_marks:
            raise CommandRefused.of(CommandCode.NO_MARK_YET)
        number = self.live.add_mark()
        self._trial.mark()
        return number

    def name_mark(self, number: int, name: str) -> None:
        """Name a mark of the running trial; it is written to the journal when the trial has ended."""
        if self.live is None or number not in self.live.marks:
            raise CommandRefused.of(CommandCode.UNKNOWN_MARK, number=number)
        self.live.mark_names[number] = name.strip()

    def tare(self) -> None:
        if self.live is None or not self.live.force:
            raise CommandRefused.of(CommandCode.NO_FORCE)
        self.live.tare()

    def acknowledge_alarm(self) -> None:
        """Silence the alarm; it disappears with its cause."""
        if self.live is not None:
            self.live.is_alarm_seen = self.live.alarm is not None

    async def _follow(self, trial: TrialProcess) -> None:
        live = self.live
        assert live is not None  # noqa: S101  (set in arm())
        try:
            await trial.follow(partial(self._update, live))
        finally:
            self.live, self._trial, self.ended = None, None, trial
            self._session.has_running_trial = False
        recorded = trial.recorded
        refusal = f"{trial.refusal} [{trial.refusal_code}]" if trial.refusal_code else trial.refusal
        sentence = recorded.sentence if recorded and not _ended_as_planned(recorded) else ""
        self._session.message = refusal or sentence or str(live.unread or "")
        if recorded is not None and recorded.file and self._session.folder is not None:
            try:
                for number, name in live.mark_names.items():
                    write_mark(self._session.folder, recorded.file, number, name)
            except JournalError as error:
                self._session.message = str(error)

    def _update(self, live: LiveTrial, telemetry: TrialTelemetry | Message[RefusalCode]) -> None:
        """Take telemetry, or the message on what cannot be read. An alarm marks its moment in the recording."""
        if isinstance(telemetry, Message):
            live.unread = telemetry
            return
        if live.update(telemetry, self.limits) and live.takes_marks and self._trial is not None:
            live.add_mark(str(live.alarm))
            self._trial.mark()
        if self._operator is not None and telemetry.state == "recording" and self._operator.is_behind(live.cue):
            self._spawn(_in_daemon_thread(self._operator.follow, live.cue))

    def _spawn(self, work: Any) -> None:
        task: asyncio.Task[None] = asyncio.get_running_loop().create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    def close(self) -> None:
        """Stop following; a running trial continues to its end."""
        for task in self._tasks:
            task.cancel()


def _ended_as_planned(recorded: Recorded) -> bool:
    """Whether the verdict alone is of interest."""
    planned = {TrialCode.CAPTURE_ENDED, TrialCode.DURATION_REACHED}
    return recorded.accepted and {message.code for message in recorded.codes} <= planned


async def _in_daemon_thread(work: Callable[[Any], None], argument: Any) -> None:
    """asyncio.to_thread without its pool, for which asyncio.run waits: the bench may answer a request late or never."""
    done: Future[None] = Future()

    def run() -> None:
        try:
            work(argument)
        except Exception as error:
            done.set_exception(error)
        else:
            done.set_result(None)

    done.set_running_or_notify_cancel()
    threading.Thread(target=run, name="simulated operator", daemon=True).start()
    await asyncio.wrap_future(done)


def _guide(spec: TrialSpec, config: StationConfig) -> Guide:
    if spec.test in BODY_TESTS and config.body is not None:
        return wearer_guide(spec.condition, config.body, is_pose=spec.test == "pose")
    return guide_for(spec.test, config.protocol)


class SimulatedOperator:
    """Operates one bench; prepare() raises SimulationError if the bench refuses."""

    def __init__(self, bench: SimulatedBench, pause_s: float) -> None:
        self._bench, self._pause_s = bench, pause_s
        self._prepared: TrialSpec | None = None
        self._step = 0
        self._lock = threading.Lock()

    def prepare(self, plan: PlanStatus) -> None:
        """Prepare the next trial: don its cuff or rest, then select the trial. Blocks."""
        with self._lock:
            self._prepare(plan)

    def is_behind(self, cue: Cue) -> bool:
        """Whether the cue is a later step than the last one carried out."""
        return cue.step > self._step

    def follow(self, cue: Cue) -> None:
        """Carry out the cue of the running trial; without effect on a bench that has ended."""
        with self._lock, suppress(SimulationError):
            if self.is_behind(cue):
                self._step = cue.step
                self._bench.request({"step": cue.step})

    def _prepare(self, plan: PlanStatus) -> None:
        spec = plan.spec
        if spec is None:
            return
        self._bench.request({"capture": False})  # one that a killed recorder left; no trial runs now
        if plan.is_new_cuff:
            self._bench.request({"don": spec.cuff})
        elif plan.has_pause and self._prepared != spec:
            self._bench.request({"pause_s": self._pause_s})
        self._prepared, self._step = spec, 0
        self._bench.request({"trial": {"cuff": spec.cuff, "test": spec.test, "condition": spec.condition}})


class TrialProcess:
    """One running trial. Its telemetry goes to on_telemetry, in the thread of the event loop."""

    def __init__(self, child: Child) -> None:
        self._child = child
        self._commands: SimpleQueue[dict[str, Any] | None] = SimpleQueue()
        self.recorded: Recorded | None = None
        self.refusal: str | None = None
        self.refusal_code = ""

    @classmethod
    async def start(
        cls, config: StationConfig, folder: Path, spec: TrialSpec, clock_port: int | None, speed: float | None
    ) -> TrialProcess:
        """Start the recorder; it opens the devices, arms and waits for the edge.

        clock_port is that of a simulated bench's clock, None for a real bench; speed is the pace of its world.
        """
        trial = cls(await asyncio.to_thread(Child, "station.session.trial_daemon", **DETACHED))
        request = TrialRequest(config=config, folder=folder, spec=spec, clock_port=clock_port, speed=speed)
        trial._commands.put(request.model_dump(mode="json"))
        threading.Thread(target=trial._send_commands, name="commands to the recorder", daemon=True).start()
        return trial

    async def follow(self, on_telemetry: Callable[[TrialTelemetry | Message[RefusalCode]], None]) -> None:
        """Return when the recorder has ended: `recorded` holds the result, or `refusal` and its code the reason.

        on_telemetry receives a Message in place of telemetry that cannot be read; for a result it is the refusal. One
        message waits at most, so that a console that is too slow still answers its pages: the recorder drops its
        oldest telemetry.
        """
        loop = asyncio.get_running_loop()
        messages: asyncio.Queue[dict[str, Any] | None] = asyncio.Queue(1)

        def receive() -> None:
            with suppress(RuntimeError, CancelledError):  # the loop is closed; the recorder continues
                for message in chain(self._child, [None]):
                    asyncio.run_coroutine_threadsafe(messages.put(message), loop).result()

        threading.Thread(target=receive, name="messages of the recorder", daemon=True).start()
        while (message := await messages.get()) is not None:
            try:
                if "result" in message:
                    self.recorded = _RECORDED.validate_python(message["result"])
                elif "refused" in message:
                    self.refusal, self.refusal_code = message["refused"], message["code"]
                else:
                    on_telemetry(TrialTelemetry.model_validate(message))
            except ValidationError as error:
                unread = Message(RefusalCode.UNREADABLE_MESSAGE, {"reason": describe_error(error)})
                if "result" in message:
                    self.refusal, self.refusal_code = str(unread), unread.code.value
                else:
                    on_telemetry(unread)
        self._commands.put(None)
        code = await asyncio.to_thread(self._child.ensure_ended, END_TIMEOUT_S)
        if self.recorded is None and self.refusal is None:
            self.refusal = str(Message(RefusalCode.RECORDER_ENDED, {"exit_code": str(code)}))

    def stop(self) -> None:
        """End the trial: cleanly at the first call, at once at the second."""
        self._commands.put({"stop": True})

    def mark(self) -> None:
        self._commands.put({"mark": True})

    def _send_commands(self) -> None:
        """In a thread, because a recorder that still starts does not receive yet."""
        with suppress(OSError):  # it has ended, and follow() returns its result
            for command in iter(self._commands.get, None):
                self._child.send(command)
