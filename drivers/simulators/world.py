"""The physical world that all simulated devices sample: a wearer, a cuff, a rope, hands, a person who raises an arm,
and the mocap system's capture.

Time is world time, which world_clock.py moves: seconds since the world began. The mocap system's crystal runs with
it; a DAQ has its own (settings.daq_clock).

Does not imitate: creep, stiffening and anisotropy of the tissue, skin that moves under the anchor's markers, ghost
markers, friction of the pulley, drift of the amplifier, the person between two trials.
"""

from __future__ import annotations

import itertools
import math
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.errors import SimulatorCode, SimulatorError
from drivers.simulators.faults import INVERSIONS, Fault, Faults
from drivers.simulators.load_script import BouncingMass, HungMass, SimulatedPull
from drivers.simulators.markers import MarkerCloud, Wearer
from drivers.simulators.settings import Settings
from drivers.simulators.wearer import BODY_TESTS, Person, Worn
from drivers.simulators.world_clock import WorldClock
from recordings.standard_gravity import g

Floats = NDArray[np.float64]
TestKind = Literal["static", "dynamic", "bounce", "pose", "motion"]


@dataclass(frozen=True)
class SimulatedTrial:
    """The trial set up on the bench; cuff is None for a bounce and for a person's trial, while a cuff remains donned.

    condition is what the person wears.
    """

    cuff: str | None
    test: TestKind
    condition: Worn | None = None


@dataclass(frozen=True)
class Capture:
    """One measurement of the mocap system, [start, end) in world seconds; end is the script's unless it was stopped."""

    number: int
    start: float
    end: float
    trial: SimulatedTrial


class World:
    """Thread-safe. Devices ask for voltages, forces and markers at times up to now(); asking moves the world on.

    Without select_trial the plan is played: every cuff donned once, protocol.repeats × (static, dynamic), then again.
    A bounce is set up by select_trial(None, "bounce"), and so is a pose or motion of the person, if the settings have
    one.
    The faults of the bench are kept with its time; the devices ask for theirs, and those of the sync line are its own.
    """

    def __init__(
        self, settings: Settings, speed: float | None = 1.0, seed: int = 0, fault_plan: Iterable[Fault] = ()
    ) -> None:
        self.settings = settings
        self.clock = WorldClock(speed)
        self._lock = threading.RLock()
        body_and_hands = np.random.default_rng((seed, 0))
        self._noise = np.random.default_rng(
            (seed, 3)
        )  # separate, so that queries of a device do not change the motion of a hand
        wearer = Wearer(settings, body_and_hands)
        self.person = Person(settings.person, tuple(settings.wiring.emg), seed) if settings.person else None
        self._cloud = MarkerCloud(settings, wearer, seed, self.person.labels if self.person else ())
        self._pull = SimulatedPull(settings, wearer.along_rope(), body_and_hands)
        self._slips = dict.fromkeys(settings.cuffs, 0.0)
        self._plan: Iterator[SimulatedTrial] | None = _plan(settings)
        self._bounce = BouncingMass(settings.bounce) if settings.bounce else None
        self._hung = HungMass()
        self._worn = next(iter(settings.cuffs))
        self._trial = next(self._plan)
        self._pull.set_up(self._worn, "static", 0.0)
        self._pull.advance(0.0)  # compiles the physics before the clock runs
        self._capture: Capture | None = None
        self._is_capturing = False
        self.faults = Faults(self.now, fault_plan)
        self._seen = 0.0  # the latest world time of any query

    @property
    def labels(self) -> tuple[str, ...]:
        """The markers' names in the order of markers()."""
        return self._cloud.labels

    def now(self) -> float:
        """World time [s]."""
        return self.clock.now()

    @property
    def speed(self) -> float | None:
        """World seconds per wall second at most; None: as fast as the data are processed."""
        return self.clock.speed

    # Signals of the devices

    def cell_force(self, t: Floats) -> Floats:
        """(n,) [N] on the load cell at world times t (n,), without noise: rope, bouncing weight, cord or known mass."""
        with self._lock:
            load = self._moved(t)[:, 2]
            if self._bounce is not None and (is_hanging := self._bounce.is_hanging(t)).any():
                load = np.where(is_hanging, self._bounce.tension(t), load)
            if self.person is not None:
                load = np.where(self.person.has_load_cell(t), self.person.tension(t), load)
            return self._hung.force(t, load)

    def amplifier_voltage(self, t: Floats) -> Floats:
        """(n,) [V] at the load cell's amplifier at t (n,), with its gain, its delay, its zero and its noise."""
        amplifier = self.settings.amplifier
        with self._lock:
            newtons = amplifier.gain * self.cell_force(t - amplifier.delay_s)
            noise = self._noise.normal(0.0, amplifier.noise_v, t.shape)
        scale = amplifier.full_scale_v / (amplifier.capacity_kg * g)
        volts: Floats = amplifier.zero_v + newtons * scale + noise
        return volts

    def sync_voltage(self, t: Floats) -> Floats:
        """(n,) [V] of the mocap system's measurement-time output at t (n,)."""
        line = self.settings.sync
        with self._lock:
            self._live(float(t.max()))
            capture = self._capture
        is_active = np.zeros(t.shape, dtype=bool)
        if capture is not None:
            is_active = (t >= capture.start) & (t < capture.end - line.before_frame_end_s)
            for stuck in self.faults.of("sync", "no_stop_edge"):
                if capture.start <= stuck.begin:
                    is_active |= (t >= capture.end) & (t < capture.end + stuck.fault.for_s)
        for turned in self.faults.of("sync", *INVERSIONS):
            is_active ^= (t >= turned.begin) & (t < turned.end)
        return np.where(is_active != line.is_inverted, line.high_v, line.low_v)

    def emg_voltage(self, channel: str, t: Floats) -> Floats:
        """(n,) [V] of an EMG amplifier's output at t (n,); 0 without electrodes."""
        with self._lock:
            self._live(float(t.max()))
            if self.person is None:
                return np.zeros(t.shape)
            return np.asarray(self.settings.wiring.emg[channel].gain * self.person.emg(channel, t))

    def markers(self, t: Floats) -> Floats:
        """(n, labels, 3) [mm] in the laboratory at t (n,), as the cameras see them; NaN where a marker is hidden."""
        with self._lock:
            weight = self._bounce.displacement(t) if self._bounce is not None else None
            moved = self._moved(t)[:, 0]
            return self._cloud.seen(t, moved, weight, self.person.markers(t) if self.person is not None else None)

    # The mocap system's capture

    @property
    def capture(self) -> Capture | None:
        """The latest capture, running or over."""
        with self._lock:
            self._live(self.now())
            return self._capture

    def start_capture(self) -> Capture:
        """Raise the sync line now and begin the script of the trial. Raises SimulatorError while a capture runs."""
        with self._lock:
            self._live(self.now())
            if self._is_capturing:
                raise SimulatorError(
                    "a capture is running; stop it before starting another", SimulatorCode.CAPTURE_RUNNING
                )
            self._hung.take_off(self._seen)
            self._pull.advance(self._seen)
            number = 1 if self._capture is None else self._capture.number + 1
            end = self._end_of_frame(self._seen, self._begin_script())
            self._capture = Capture(number, self._seen, end, self._trial)
            self._is_capturing = True
            self.faults.capture_started(number, self._seen)
            return self._capture

    def follow(self, step: int) -> None:
        """The console that leads the hands is at this step of the running trial; no effect without a capture."""
        with self._lock:
            self._live(self.now())
            if self._capture is not None and self._is_capturing and math.isinf(self._capture.end):
                until = self._pull.follow(step, self._seen)
                self._capture = replace(self._capture, end=self._end_of_frame(self._capture.start, until))

    def stop_capture(self) -> Capture:
        """Lower the sync line at the end of this frame; the hands remove every load.

        Raises SimulatorError when no capture runs.
        """
        with self._lock:
            self._live(self.now())
            if self._capture is None or not self._is_capturing:
                raise SimulatorError("no capture is running", SimulatorCode.NO_CAPTURE)
            self._capture = replace(self._capture, end=self._end_of_frame(self._capture.start, self._seen))
            self._live(self._capture.end)
            return self._capture

    def ensure_no_capture(self) -> bool:
        """End a capture that runs, as an operator at the mocap PC does; returns whether one ran."""
        with self._lock:
            self._live(self.now())
            is_ended = self._is_capturing
            if is_ended:
                self.stop_capture()
            return is_ended

    # The trial on the bench

    def hang(self, mass_kg: float) -> None:
        """Hangs a known mass from the load cell in the place of the rig, 0 for the empty cell; ends a running capture.

        It hangs until the next capture begins.
        """
        with self._lock:
            self.ensure_no_capture()
            self._hung.hang(mass_kg, self._seen)

    @property
    def trial(self) -> SimulatedTrial:
        """The trial that is captured now, or else the next one."""
        with self._lock:
            self._live(self.now())
            return self._trial

    def select_trial(self, cuff: str | None, test: TestKind, condition: Worn | None = None) -> SimulatedTrial:
        """Sets this trial up and leaves the plan; it is played until another is selected. Another cuff is donned first.

        A bounce, a pose and a motion have no cuff. Raises SimulatorError for an unknown cuff or test, or while a
        capture runs.
        """
        return self._select(SimulatedTrial(cuff, test, condition), is_donning=cuff not in (self._worn, None))

    def don(self, cuff: str) -> SimulatedTrial:
        """Don the cuff again, without slip, and set up its static test. Raises SimulatorError as select_trial."""
        return self._select(SimulatedTrial(cuff, "static"), is_donning=True)

    def truth(self) -> dict[str, Any]:
        """True values for a fit: the parameters by cuff, and the slip of each cuff since it was donned [m]."""
        with self._lock:
            self._live(self.now())
            self._pull.advance(self._seen)
            self._slips[self._worn] = self._pull.slip
            cuffs = {name: cuff.model_dump() for name, cuff in self.settings.cuffs.items()}
            return {"cuffs": cuffs, "slip_m": dict(self._slips)}

    def _select(self, trial: SimulatedTrial, *, is_donning: bool) -> SimulatedTrial:
        self._refuse_unknown(trial)
        with self._lock:
            self._live(self.now())
            if self._is_capturing:
                raise SimulatorError(
                    f"a capture of {self._trial.cuff} {self._trial.test} is running; stop it first",
                    SimulatorCode.CAPTURE_RUNNING,
                )
            self._plan = None
            self._set_up(trial, is_donning=is_donning)
            return self._trial

    def _refuse_unknown(self, trial: SimulatedTrial) -> None:
        """Raises SimulatorError where the settings have no such trial."""
        of_cuff = trial.cuff in self.settings.cuffs and trial.test in ("static", "dynamic")
        of_bounce = (trial.cuff, trial.test) == (None, "bounce") and self._bounce is not None
        of_person = trial.cuff is None and trial.test in BODY_TESTS and self.person is not None
        if not (of_cuff or of_bounce or of_person):
            known = ", ".join(self.settings.cuffs)
            bounce = "; a bounce has no cuff" if self._bounce else ", and the settings have no bounce"
            person = "; a pose and a motion have no cuff" if self.person else ", and no person"
            raise SimulatorError(
                f"no trial {trial.cuff!r} {trial.test!r}; cuffs are {known}, tests are static and dynamic{bounce}"
                f"{person}",
                SimulatorCode.UNKNOWN_TRIAL,
            )

    # Everything below is called with the lock held

    def _begin_script(self) -> float:
        """Begin the script of the trial; returns its end."""
        if self._trial.test == "bounce" and self._bounce is not None:
            return self._bounce.begin(self._seen)
        if self._trial.test in BODY_TESTS and self.person is not None:
            return self.person.begin(self._seen)
        return self._pull.begin(self._seen, is_led=self.settings.operator.hands == "led")

    def _end_of_frame(self, start: float, end: float) -> float:
        """The mocap system captures whole frames: the end of the one that is exposed at `end`."""
        if math.isinf(end):
            return end
        rate_hz = self.settings.mocap.rate_hz
        return start + math.ceil((end - start) * rate_hz - 1e-6) / rate_hz

    def _moved(self, t: Floats) -> Floats:
        """(n, 3) at t (n,): displacement [m], slip [m], load [N]."""
        until = float(t.max())
        self._live(until)
        self._pull.advance(until)
        return self._pull.at(t)

    def _live(self, until: float) -> None:
        """Up to `until`, the capture may end and the next trial be set up."""
        self._seen = max(self._seen, until)
        if self._is_capturing and self._capture is not None and self._capture.end <= until:
            self._pull.advance(self._capture.end)
            self._is_capturing = False
            following = self._trial if self._plan is None else next(self._plan)
            self._set_up(following, is_donning=following.cuff not in (self._worn, None))

    def _set_up(self, trial: SimulatedTrial, *, is_donning: bool) -> None:
        self._slips[self._worn] = self._pull.slip
        self._trial, self._worn = trial, trial.cuff or self._worn
        if is_donning:
            self._slips[self._worn] = 0.0
        if self._bounce is not None:
            (self._bounce.hang if trial.test == "bounce" else self._bounce.take_off)(self._seen)
        if self.person is not None:
            self.person.set_up(trial.test, trial.condition, self._seen)
        self._pull.set_up(self._worn, "dynamic" if trial.test == "dynamic" else "static", self._slips[self._worn])


def _plan(settings: Settings) -> Iterator[SimulatedTrial]:
    """The trials of the protocol in order, repeated without end."""
    for cuff in itertools.cycle(settings.cuffs):
        for _ in range(settings.protocol.repeats):
            yield SimulatedTrial(cuff, "static")
            yield SimulatedTrial(cuff, "dynamic")
