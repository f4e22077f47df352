"""A pull along one axis from a trial without markers, for fits that read force and displacement alone."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from fitting.dynamic.errors_in_variables import Swing
from fitting.pull.cuff_motion import CuffMotion, MarkerQuality
from fitting.pull.pull import Pull
from fitting.trial.clocks import LagUncertainty
from fitting.trial.trial import Trial
from recordings.manifest import CuffSite
from tests.fitting.experiment import ANCHOR, CUFF, PULL, sum_of_sines

STIFFNESS, DAMPING, MASS = 5500.0, 120.0, 0.2
LABELS = ("anchor_1", "anchor_2", "anchor_3", "anchor_4")
STEP = 0.01


def trial_of(
    cuff: CuffSite,
    force: tuple[NDArray[np.float64], NDArray[np.float64]],
    markers: tuple[NDArray[np.float64], tuple[str, ...], NDArray[np.float64]],
    lag: LagUncertainty | None = None,
    **more: object,
) -> Trial:
    """A trial, the first static one of a donning if nothing else is given.

    force is time [s] and force [N], markers are time [s], labels and positions (frames, markers, 3) [m].
    """
    usual = {"test": "static", "repeat": 1, "donning": "1", "start_utc_ns": 0, "file": "a.mcap", "sha256": ""}
    given = usual | {"run": more.get("repeat", 1), "force_step": 0.0} | more
    time, values = force
    frames, labels, positions = markers
    record = {"force_time": time, "force": values, "marker_time": frames, "labels": labels, "markers": positions}
    return Trial(cuff=cuff, lag=lag or LagUncertainty(0.0, 0.0, 0.0), **record, **given)  # type: ignore[arg-type]


def pull_of(trial: Trial, displacement: NDArray[np.float64]) -> Pull:
    """displacement (frames,) [m] along x."""
    frames = len(displacement)
    still, along_x = np.zeros((frames, 3)), np.array([1.0, 0.0, 0.0])
    motion = CuffMotion(
        displacement=displacement[:, None] * along_x,
        residual=np.zeros(frames),
        body=still,
        turn=np.zeros(frames),
        rope=None,
        ghosts={},
        anchor=np.zeros((0, 3)),
    )
    return Pull(
        trial=trial,
        force_time=trial.force_time,
        force=trial.force,
        marker_time=trial.marker_time,
        displacement=displacement,
        motion=motion,
        direction=along_x,
        markers=MarkerQuality(0.0, {}, 0.0, 0.0, 0.0),
        plateaus=(),
        notes=(),
    )


# Records of a swing whose truth is written out: F = k x + c ẋ + m ẍ + offset, with noise of any colour.


def swing(
    seed: int,
    *,
    k: float = STIFFNESS,
    c: float = DAMPING,
    force_noise: float = 0.25,
    marker_noise: float = 0.157e-3,
    colour: float = 0.0,
    seconds: float = 20.0,
    rate: float = 250.0,
    frequency: float = 1.0,
    lag_sd: float = 0.0,
    lag_error: float = 0.0,
) -> Swing:
    """About ± 12 N at a frequency that wanders; marker noise with a correlation time of `colour` seconds.

    The true lag is drawn from its prior, lag_sd; lag_error comes on top of it.
    """
    random = np.random.default_rng(seed)
    force_time, marker_time = np.arange(0, seconds, 1 / rate), np.arange(0.003, seconds, 0.01)
    turn = 2 * np.pi * frequency * np.array([1.0, *random.uniform(0.85, 1.15, 3)])
    size = 12.0 / k * np.array([1.0, *(0.15 * random.standard_normal(3))])
    phase = random.uniform(0, 6.28, 4)

    def motion(t: NDArray[np.float64], order: int) -> NDArray[np.float64]:
        each = size * turn**order * np.sin(np.outer(t, turn) + phase + order * np.pi / 2)
        return np.asarray(each.sum(axis=1))

    at = force_time + lag_sd * random.standard_normal() + lag_error
    force = k * motion(at, 0) + c * motion(at, 1) + MASS * motion(at, 2) + 25.0
    noise = random.standard_normal(len(marker_time) + 2000)
    if colour:
        memory = np.exp(-0.01 / colour)
        noise = lfilter([np.sqrt(1 - memory**2)], [1, -memory], noise)
    return Swing(
        force_time,
        force + force_noise * random.standard_normal(len(force_time)),
        marker_time,
        motion(marker_time, 0) + marker_noise * noise[2000:],
        MASS,
        lag_sd,
    )


# Static trials of a cuff that holds, creeps, stiffens or slips: weights on a rope, seen by a load cell and by
# cameras. Imports nothing of solver, drivers or what is fitted with: cuff displacement is integrated from its own
# laws here. A standard linear solid creeps, an exponential spring stiffens, friction with a growing limit slips.


@dataclass(frozen=True)
class Held:
    """One cuff and its rig; SI units. The newtons of the weights are hung on one by one, and taken off if it unloads.

    creep is the part by which an instantly elastic cuff yields more in the long run, with a time constant; stiffness is
    then that at rest. stiffening is b of dF/dx = stiffness + b F; yielding adds so much of the way for each newton. It
    slips beyond first_slip, by 1/hardening a newton.
    """

    stiffness: float = 8520.0
    creep: float = 0.0
    creep_time: float = 15.0
    stiffening: float = 0.0
    yielding: float = 0.0
    first_slip: float = np.inf
    hardening: float = 20e3
    weights: tuple[float, ...] = (15.0, 15.0, 15.0, 15.0, 15.0)
    hook: float = 2.0
    hold: float = 8.0
    unloads: bool = False
    force_rate: float = 20.0
    force_noise: float = 0.51
    zero: float = 1.0
    drift: float = 0.0
    marker_noise: float = 0.2e-3
    sway: float = 2e-3
    occlusion: float = 0.0
    ghosts: float = 0.0


def static_trial(truth: Held, seed: int) -> tuple[Trial, float]:
    """The trial, and how far the cuff has slipped at its end [m]."""
    random = np.random.default_rng(seed)
    time, load = _load(truth, random)
    x, slip = _way(truth, load)
    force_time = np.arange(0.0, time[-1], 1 / truth.force_rate)
    force = np.interp(force_time, time, load) + truth.zero + truth.drift * force_time
    force += truth.force_noise * random.standard_normal(len(force_time))
    body = np.repeat(np.vstack((ANCHOR, CUFF))[None], len(time), axis=0)
    body[:, -1] += x[:, None] * PULL
    lab = body + truth.sway * np.column_stack([wander(time, random) for _ in range(3)])[:, None]
    lab += truth.marker_noise * random.standard_normal(lab.shape)
    _spoil(lab, truth, random)
    site, lag = CuffSite("hand", "arm", LABELS, ("cuff_1",)), LagUncertainty(0.0, 0.5e-3, 0.0)
    return trial_of(site, (force_time, force), (time, (*LABELS, "cuff_1"), lab), lag), slip


def _load(truth: Held, random: np.random.Generator) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    steps = [*truth.weights, *([-weight for weight in reversed(truth.weights)] if truth.unloads else [])]
    time = np.arange(0.0, truth.hold * (len(steps) + 1), STEP)
    load = np.full(len(time), truth.hook)
    for i, step in enumerate(steps, 1):
        load += step * np.clip((time - truth.hold * i - random.uniform(-0.3, 0.3)) / 0.4, 0, 1)
    return time, load


def _way(truth: Held, load: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Displacement (n,) [m]: elastic, with what has crept and slipped."""
    if truth.stiffening:
        elastic = np.log1p(truth.stiffening * load / truth.stiffness) / truth.stiffening
    else:
        elastic = load / truth.stiffness * (1 + truth.yielding * load)
    # At once 1/(1 + creep) of the way at rest; the other part follows the load with the time constant.
    pace = STEP / truth.creep_time
    late, _ = lfilter([pace], [1.0, pace - 1.0], elastic, zi=[(1 - pace) * elastic[0]])
    crept = (elastic + truth.creep * late) / (1 + truth.creep)
    limit = np.maximum(np.maximum.accumulate(load) - truth.first_slip, 0.0)
    slip = limit / truth.hardening
    return crept + slip, float(slip[-1])


def _spoil(lab: NDArray[np.float64], truth: Held, random: np.random.Generator) -> None:
    """Markers hidden for 0.1 s, and ghosts 15 mm away for one to five frames; so many a minute and marker."""
    for marker in range(lab.shape[1]):
        for start in np.flatnonzero(random.random(len(lab)) < truth.occlusion / 6000):
            lab[start : start + 10, marker] = np.nan
        for start in np.flatnonzero(random.random(len(lab)) < truth.ghosts / 6000):
            away = random.standard_normal(3)
            lab[start : start + random.integers(1, 6), marker] += 0.015 * away / np.linalg.norm(away)


def wander(time: NDArray[np.float64], random: np.random.Generator) -> NDArray[np.float64]:
    """A slow random curve of unit size between 0.05 and 0.8 Hz, at times (n,) of equal distance."""
    terms = [(random.standard_normal(), random.uniform(0.05, 0.8), random.uniform(0, 6.3)) for _ in range(6)]
    return sum_of_sines(time, *np.array(terms).T) / np.sqrt(3)
