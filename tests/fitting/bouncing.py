"""A weight on a steel spring under a load cell, from Hooke and Newton: imports nothing of solver, drivers or fitting.

The spring is a chain of masses, so that its own weight and surge are there; the load cell feels its uppermost link.
"""

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.constants import g
from scipy.linalg import expm
from scipy.signal import butter, lfilter

from recordings.manifest import BounceRig, LoadCell, Manifest, Timing
from recordings.reader import Track
from tests.fitting.experiment import track

STEP = 5e-4
LINKS = 6


@dataclass(frozen=True)
class Bounce:
    """The bench and what is wrong with it. SI units; lag: a force sample stamped t was taken at t + lag."""

    mass: float = 2.5
    spring_mass: float = 0.0
    frequency: float = 1.0
    amplitude: float = 0.08
    damping_ratio: float = 0.002
    duration: float = 30.0
    lag: float = 0.0
    gain: float = 1.0
    zero: float = 1.5
    filter_hz: float = 0.0
    force_rate: float = 1000.0
    marker_rate: float = 100.0
    force_noise: float = 0.51
    marker_noise: float = 0.2e-3
    newtons_per_volt: float = 50 * 9.80665 / 5
    polarity: int = 1
    ghosts: float = 0.0
    occlusion: float = 0.0
    down: tuple[float, float, float] = (0.0, 0.0, -1.0)


def recorded(truth: Bounce, seed: int, run: int = 1) -> tuple[Manifest, dict[str, Track]]:
    """Manifest and tracks of one bounce; the edge is where sample 2 s lies exactly, so that no edge error is left."""
    random = np.random.default_rng(seed)
    time, way, force = _swing(truth, float(random.uniform(0, 2 * np.pi)))
    if truth.filter_hz:
        b, a = butter(1, truth.filter_hz * 2 * STEP)
        force = lfilter(b, a, force - force[0]) + force[0]
    rate, start_ns = truth.force_rate, 1_700_000_000_000_000_000
    numbers = np.arange(int((truth.duration + 0.4) * rate))
    sampled = np.interp(numbers / rate + truth.lag, time, force)
    newtons = truth.polarity * truth.gain * sampled + truth.zero
    volts = (newtons + truth.force_noise * random.standard_normal(len(numbers))) / truth.newtons_per_volt
    frames = np.arange(int(truth.duration * truth.marker_rate))
    frame_time = frames / truth.marker_rate
    place = np.array([0.2, -0.4, 1.1]) + np.interp(frame_time, time, way)[:, None] * np.array(truth.down)
    place += truth.marker_noise * random.standard_normal(place.shape)
    place[random.random(len(frames)) < truth.ghosts] += 0.03
    place[random.random(len(frames)) < truth.occlusion] = np.nan
    values = np.concatenate((1e3 * place, np.full((len(frames), 1), 0.4)), axis=1)[:, None].astype(np.float32)
    tracks = {
        "/force": track("/force", "V", ("ai0",), rate, numbers, numbers / rate, start_ns, volts[:, None]),
        "/markers": track("/markers", "mm", ("weight",), truth.marker_rate, frames + 1, frame_time, start_ns, values),
    }
    cell, rig = LoadCell("daq", truth.newtons_per_volt, 1), BounceRig(truth.mass, "weight", truth.spring_mass)
    timing = Timing(lag_sd_s=0.0, stop_edge="end_of_frame")
    manifest = Manifest(None, "bounce", 1, run, "1", "pfi0", 2.5, cell, start_ns, rig, timing=timing)
    return manifest, tracks


def _swing(truth: Bounce, phase: float) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Time from 0.5 s before the edge on, the weight's way downward from rest [m], and what the cell feels [N].

    The chain's motion about rest is linear: state(t + STEP) = expm(A STEP) state(t).
    """
    links = LINKS if truth.spring_mass else 1
    masses = np.full(links, truth.spring_mass / links)
    masses[-1] = truth.mass + truth.spring_mass / links / 2  # the other half of a link hangs at the cell itself
    omega = 2 * np.pi * truth.frequency
    stiffness = links * omega**2 * (truth.mass + truth.spring_mass / 3)
    coupling = 2 * np.eye(links) - np.eye(links, k=1) - np.eye(links, k=-1)
    coupling[-1, -1] = 1
    damping = 2 * truth.damping_ratio / omega * stiffness
    a = np.zeros((2 * links, 2 * links))
    a[:links, links:] = np.eye(links)
    a[links:, :links] = -stiffness * coupling / masses[:, None]
    a[links:, links:] = -damping * coupling / masses[:, None]
    count = int((truth.duration + 2.5) / STEP)
    share = np.arange(1, links + 1) / links
    start = truth.amplitude * np.concatenate((share * np.cos(phase), -omega * share * np.sin(phase)))
    states = _powers(tuple(a.ravel()), 2 * links, count) @ start
    time = STEP * np.arange(count) - 0.5
    force = stiffness * states[:, 0] + damping * states[:, links] + (truth.mass + truth.spring_mass) * g
    return time, states[:, links - 1], force


@cache
def _powers(a: tuple[float, ...], size: int, count: int) -> NDArray[np.float64]:
    """expm(A STEP n) for n < count, (count, size, size)."""
    once = expm(np.array(a).reshape(size, size) * STEP)
    found = np.empty((count, size, size))
    found[0] = np.eye(size)
    done = 1
    power = once
    while done < count:
        more = min(done, count - done)
        found[done : done + more] = found[:more] @ power
        done += more
        power = power @ power
    return found
