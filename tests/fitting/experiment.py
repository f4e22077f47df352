"""A small independent experiment: a cuff with mass on a body that sways, pulled by a rope, seen by both instruments.

Derived from the balance of forces at the cuff, not from the fitted law: imports nothing of solver, drivers or fitting.
Between cuff and body a spring and a damper work in series with friction that holds up to a limit and gives way
slowly beyond it; the limit grows with the way slipped.
"""

from dataclasses import dataclass, replace

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.signal import lfilter

from recordings.manifest import CuffSite, LoadCell, Manifest, Timing
from recordings.reader import Track
from recordings.samples import Stream

PUBLISHED = {
    "waist": (2140.0, 124.0, 0.012),
    "hand": (8520.0, 210.0, 0.012),
    "tube": (5510.0, 38.0, 0.009),
    "elbow": (2530.0, 139.0, 0.022),
}
ANCHOR = np.array([[0.0, 0.04, 0.0], [0.05, -0.03, 0.10], [-0.05, -0.02, 0.14], [0.02, 0.05, 0.22]])
CUFF = np.array([0.03, 0.07, 0.12])
PULL = np.array([0.36, 0.48, 0.80])
WEIGHTS = (15.0, 30.0, 45.0, 60.0, 75.0)
ROPE = np.array([[0.18], [0.42]])
"""Metres along the rope from the cuff to the markers on it."""
STEP = 5e-4
"""Seconds of the integration."""


@dataclass(frozen=True)
class Truth:
    """The cuff, the rig and what is wrong with it. SI units; rates in Hz."""

    cuff: str = "hand"
    stiffness: float = 8520.0
    damping: float = 210.0
    migration: float = 0.012
    friction: float = 12.0
    slowness: float = 400.0
    mass: float = 0.2
    force_rate: float = 1000.0
    marker_rate: float = 100.0
    weights: tuple[float, ...] = WEIGHTS
    hold: float = 5.0
    hold_jitter: float = 0.3
    unloads_at_once: bool = False
    frequency: float = 1.0
    amplitude: float = 12.0
    duration: float = 22.0
    marker_noise: float = 0.2e-3
    marker_memory: float = 0.0
    volt_noise: float = 5e-3
    volts_per_code: float = 20 / 4096
    volt_zero: float = 0.03
    zero_drift: float = 0.0
    newtons_per_volt: float = 50 * 9.80665 / 5
    clock_ppm: float = 30e-6
    lag: float = 0.0
    sway: float = 2e-3
    sway_angle: float = 5e-3
    occlusion: float = 0.0
    has_rope_markers: bool = False


def published(cuff: str, **changes: object) -> Truth:
    stiffness, damping, migration = PUBLISHED[cuff]
    return replace(Truth(cuff=cuff, stiffness=stiffness, damping=damping, migration=migration), **changes)  # type: ignore[arg-type]


class Session:
    """One donning: the cuff keeps its slip from trial to trial. Trials come as manifest and tracks."""

    def __init__(self, truth: Truth, seed: int, donning: str = "1") -> None:
        self.truth, self.random, self.donning = truth, np.random.default_rng(seed), donning
        self.slip = 0.0
        self.trials = 0

    def static(self, repeat: int = 1) -> tuple[Manifest, dict[str, Track]]:
        truth = self.truth
        up = (0.0, *truth.weights)
        levels = (*up, 0.0) if truth.unloads_at_once else (*up, *truth.weights[-2::-1], 0.0)
        time = np.arange(0.0, truth.hold * len(levels), STEP)
        load = np.full(len(time), 2.0)  # the hook
        for i in range(1, len(levels)):
            step = levels[i] - levels[i - 1]
            since = time - i * truth.hold - self.random.uniform(-truth.hold_jitter, truth.hold_jitter)
            start = int(np.searchsorted(since, 0.0, side="right"))
            end = start + int(20 / STEP)  # then the swing is below the rounding of the load
            since = since[start:end]
            load[start:end] += step * np.clip(since / 0.3, 0, 1)
            load[start:end] += 0.03 * step * np.exp(-since / 0.5) * np.sin(8 * since)
            load[end:] += step
        return self._record("static", repeat, time, load)

    def dynamic(self, repeat: int = 1) -> tuple[Manifest, dict[str, Track]]:
        truth = self.truth
        time = np.arange(0.0, truth.duration + 8.0, STEP)
        hand = 1 + 0.15 * self._wander(time, 0.1, 0.5)
        phase = 2 * np.pi * truth.frequency * time + 0.4 * self._wander(time, 0.1, 0.8)
        swinging = np.clip((time - 4) / 1.0, 0, 1) * np.clip((time[-1] - 3 - time) / 1.0, 0, 1)
        hung = np.clip((time - 2.5) / 0.4, 0, 1) * np.clip((time[-1] - 2 - time) / 0.4, 0, 1)
        return self._record(
            "dynamic", repeat, time, 2.0 + 23.0 * hung + swinging * truth.amplitude * hand * np.sin(phase)
        )

    def _record(
        self, test: str, repeat: int, time: NDArray[np.float64], load: NDArray[np.float64]
    ) -> tuple[Manifest, dict[str, Track]]:
        truth = self.truth
        highest = max(truth.weights) + 2.0
        hardening = (highest - truth.friction) / truth.migration if truth.migration else 1e9
        x, slip = _move(
            load, truth.stiffness, truth.damping, truth.mass, truth.friction, hardening, truth.slowness, self.slip
        )
        self.slip = float(slip[-1])
        seen = self.exposed(time)
        shifts = np.zeros((len(seen), len(ANCHOR) + 1, 3))
        shifts[:, -1] = x[seen, None] * PULL
        return self.assemble(test, repeat, time, load, shifts)

    def exposed(self, time: NDArray[np.float64]) -> NDArray[np.intp]:
        """Which of `time` (n,) each frame shows, (frames,)."""
        frame_time = np.arange(int(time[-1] * self.truth.marker_rate)) / self.truth.marker_rate
        return np.searchsorted(time, frame_time - STEP / 2)

    def assemble(
        self,
        test: str,
        repeat: int,
        time: NDArray[np.float64],
        load: NDArray[np.float64],
        shifts: NDArray[np.float64],
        pull: NDArray[np.float64] = PULL,
    ) -> tuple[Manifest, dict[str, Track]]:
        """What both instruments make of a load (n,) [N] and of how markers move on the body, (frames, markers, 3).

        pull (3,) is the direction of the rope. Markers on it move with the last of the others, the cuff's.
        """
        truth = self.truth
        start_ns = 1_700_000_000_000_000_000 + int(self.trials * 120e9)
        self.trials += 1
        body, labels = np.vstack((ANCHOR, CUFF)), tuple(f"anchor_{i + 1}" for i in range(len(ANCHOR)))
        rope: tuple[str, ...] = ()
        if truth.has_rope_markers:
            rope = ("rope_1", "rope_2")
            body = np.vstack((body, CUFF + ROPE * pull))
            shifts = np.concatenate((shifts, shifts[:, [-1, -1]]), axis=1)
        tracks = self._daq(time, load, start_ns)
        tracks["/markers"] = self._mocap(body + shifts, (*labels, "cuff_1", *rope), start_ns)
        site = CuffSite(truth.cuff, "waist" if truth.cuff == "waist" else "arm", labels, ("cuff_1",), rope)
        cell, timing = LoadCell("daq", truth.newtons_per_volt, 1), Timing(stop_edge="end_of_frame")
        trial = site, test, repeat, repeat, self.donning
        manifest = Manifest(*trial, "sync_edge", 2.5, cell, start_ns, timing=timing)  # type: ignore[arg-type]
        return manifest, tracks

    def _daq(self, time: NDArray[np.float64], load: NDArray[np.float64], start_ns: int) -> dict[str, Track]:
        """Two seconds before the edge, half a second after the capture; sample clock fast by clock_ppm."""
        truth, rate = self.truth, self.truth.force_rate
        edge = 2.0 + self.random.uniform(0, 1 / rate)
        count = int((edge + time[-1] + 0.5) * rate)
        device = np.arange(count) / rate
        true = (device - edge) / (1 + truth.clock_ppm)
        volts = np.interp(true + truth.lag, time, load, left=load[0]) / truth.newtons_per_volt + truth.volt_zero
        volts += truth.zero_drift / truth.newtons_per_volt * true
        volts += truth.volt_noise * self.random.standard_normal(count)
        capture_end = int(time[-1] * truth.marker_rate) / truth.marker_rate
        sync = np.where((true >= 0) & (true < capture_end), 5.0, 0.0) + 2e-3 * self.random.standard_normal(count)
        return {
            name: track(name, "V", ("ai",), rate, np.arange(count), true, start_ns, self._coded(values)[:, None])
            for name, values in (("/force", volts), ("/sync", sync))
        }

    def _coded(self, volts: NDArray[np.float64]) -> NDArray[np.float64]:
        step = self.truth.volts_per_code
        return volts if step == 0 else step * np.round(volts / step)

    def _mocap(self, body: NDArray[np.float64], labels: tuple[str, ...], start_ns: int) -> Track:
        """Markers (frames, markers, 3) on the body, seen in the laboratory. Frame 1 is exposed at the edge."""
        truth, count = self.truth, len(body)
        frame_time = np.arange(count) / truth.marker_rate
        sway = truth.sway * np.column_stack([self._wander(frame_time, 0.05, 0.8) for _ in range(3)])
        turn = truth.sway_angle * np.column_stack([self._wander(frame_time, 0.05, 0.8) for _ in range(3)])
        lab = np.einsum("fij,fmj->fmi", _rotations(turn), body) + sway[:, None]
        lab += np.array([0.4, -0.2, 1.1])
        lab += truth.marker_noise * self._remembered(self.random.standard_normal(lab.shape))
        values = np.concatenate((1e3 * lab, np.full((*lab.shape[:2], 1), 0.5)), axis=2).astype(np.float32)
        for marker in range(values.shape[1]):
            values[self._hidden(count), marker] = np.nan
        return track("/markers", "mm", labels, truth.marker_rate, np.arange(1, count + 1), frame_time, start_ns, values)

    def _remembered(self, white: NDArray[np.float64]) -> NDArray[np.float64]:
        """White noise (frames, …), or first-order autoregressive noise of the same size where markers have a memory."""
        if self.truth.marker_memory == 0:
            return white
        memory = float(np.exp(-1 / self.truth.marker_rate / self.truth.marker_memory))
        return np.asarray(lfilter([np.sqrt(1 - memory**2)], [1.0, -memory], white, axis=0))

    def _hidden(self, count: int) -> NDArray[np.intp]:
        """Frames in which one marker is hidden, in stretches of 0.1 s."""
        starts = np.flatnonzero(self.random.random(count) < self.truth.occlusion / 10)
        return np.unique(np.minimum(starts[:, None] + np.arange(10), count - 1))

    def _wander(self, time: NDArray[np.float64], low: float, high: float) -> NDArray[np.float64]:
        """A slow random curve of unit size between two frequencies, at times (n,) of equal distance."""
        frequencies = self.random.uniform(low, high, 8)
        phases = self.random.uniform(0, 2 * np.pi, 8)
        return sum_of_sines(time, self.random.standard_normal(8), frequencies, phases) / 2


def sum_of_sines(
    time: NDArray[np.float64],
    weights: NDArray[np.float64],
    frequencies: NDArray[np.float64],
    phases: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Σ w sin(2πf t + φ) at times (n,) [s] of equal distance, of terms (k,).

    The sine of a time is that of the start of its block and of its place in the block: 100 times fewer of them.
    """
    starts = 2 * np.pi * np.outer(time[::100], frequencies) + phases
    places = 2 * np.pi * np.outer(frequencies, time[:100] - time[0])
    curve = (weights * np.sin(starts)) @ np.cos(places) + (weights * np.cos(starts)) @ np.sin(places)
    return np.asarray(curve.ravel()[: len(time)])


def track(
    name: str,
    unit: str,
    labels: tuple[str, ...],
    rate: float,
    numbers: NDArray[np.int64],
    true_time: NDArray[np.float64],
    start_ns: int,
    values: NDArray[np.float64] | NDArray[np.float32],
) -> Track:
    """Blocks of 50 ms; the host's clock runs with the mocap's, and a block arrives 4 ms after its last sample."""
    device_ns = np.round(1e9 * numbers / rate).astype(np.int64)
    block = np.arange(len(numbers)) // max(1, int(rate / 20))
    last = np.searchsorted(block, block, side="right") - 1
    host_ns = start_ns + np.round(1e9 * (true_time[last] + 4e-3)).astype(np.int64)
    return Track(Stream(name, unit, labels, rate, "simulated"), numbers.astype(np.uint64), device_ns, host_ns, values)


def _rotations(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    angle = np.linalg.norm(turn, axis=1)[:, None, None]
    zero = np.zeros(len(turn))
    a, b, c = turn.T
    cross = np.array([[zero, -c, b], [c, zero, -a], [-b, a, zero]]).transpose(2, 0, 1)
    safe = np.maximum(angle, 1e-12)
    return np.eye(3) + np.sin(angle) / safe * cross + (1 - np.cos(angle)) / safe**2 * cross @ cross


@njit(cache=True)
def _rates(x, v, s, load, stiffness, damping, mass, friction, hardening, slowness):  # type: ignore[no-untyped-def]
    stretch = x - s
    limit = friction + hardening * s
    slip = max(0.0, (stiffness * stretch + damping * v - limit) / (slowness + damping))
    carried = stiffness * stretch + damping * (v - slip)
    return v, (load - carried) / mass, slip


@njit(cache=True)
def _move(load, stiffness, damping, mass, friction, hardening, slowness, slip):  # type: ignore[no-untyped-def]
    """Runge-Kutta of the cuff at rest under the first load; returns its place and slip at every step.

    Between steps the load goes straight: held for a step, it would lag by half of one, 0.4 to 2 % of the damping.
    """
    x, v, s, h = slip + load[0] / stiffness, 0.0, slip, STEP
    places, slips = np.empty(len(load)), np.empty(len(load))
    for i in range(len(load)):
        places[i], slips[i] = x, s
        f, after = load[i], load[min(i + 1, len(load) - 1)]
        between = (f + after) / 2
        p = (stiffness, damping, mass, friction, hardening, slowness)
        a1, b1, c1 = _rates(x, v, s, f, *p)
        a2, b2, c2 = _rates(x + h / 2 * a1, v + h / 2 * b1, s + h / 2 * c1, between, *p)
        a3, b3, c3 = _rates(x + h / 2 * a2, v + h / 2 * b2, s + h / 2 * c2, between, *p)
        a4, b4, c4 = _rates(x + h * a3, v + h * b3, s + h * c3, after, *p)
        x += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
        v += h / 6 * (b1 + 2 * b2 + 2 * b3 + b4)
        s += h / 6 * (c1 + 2 * c2 + 2 * c3 + c4)
    return places, slips
