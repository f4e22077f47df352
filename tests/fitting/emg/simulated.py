"""EMG of a known muscle: Gaussian noise of EMG's band whose standard deviation is the muscle's activation, and pairs of
EMG and activation with other kinds of noise, whose lag and correlation are known.

Does not imitate: crosstalk, movement of the electrode over the muscle, hum, an amplifier that clips.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from fitting.emg.envelopes import EnvelopeSettings, emg_envelope, smooth
from fitting.emg.shape import ShapeOutcome, compare_shapes

Array = NDArray[np.float64]
Noise = Literal[
    "none",
    "amplifier",
    "gain drift",
    "disagreement",
    "few motor units",
    "stationary disagreement",
    "stationary gain drift",
]
NOISES: tuple[Noise, ...] = get_args(Noise)
RATE, MODEL_RATE = 1000.0, 100.0
BAND = signal.butter(2, (40.0, 200.0), "bandpass", fs=RATE, output="sos")
UNIT_RATE = 400.0
"""Discharges a second of all motor units together at the peak."""
REPEATS = 25
"""EMG of the same movement from which the true correlation is computed: a fifth of the standard error of one."""
FAST: tuple[Noise, ...] = ("none", "amplifier", "few motor units")


@dataclass(frozen=True, eq=False)
class EmgPair:
    """Envelope and activation (n,) at MODEL_RATE, the lag [s] of the EMG, and its true correlation.

    correlation is that at the lag, correlation_unshifted that at lag 0: E Cov(e, a) / (s √E Var e) over EMG of the same
    movement, all within half a second of neither end.
    """

    time: Array
    envelope: Array
    activation: Array
    lag: float
    correlation: float
    correlation_unshifted: float


def activation(time: Array, *, peak: float = 3.0, width: float = 1.2) -> Array:
    """A raise of the arm: rest, a burst that rises faster than it falls, rest; 0.02 to 0.4."""
    return np.asarray(0.02 + 0.38 * _burst(time, peak, width))


def raw_emg(level: Array, random: np.random.Generator, channels: int = 1) -> Array:
    """(n, channels) at RATE, band of 40 to 200 Hz; level (n,) or (n, channels) is the standard deviation."""
    noise = signal.sosfilt(BAND, random.standard_normal((len(level) + 500, channels)), axis=0)[500:]
    return np.asarray(level.reshape(len(level), -1) * noise / noise.std())


def emg_pairs(noise: Noise, settings: EnvelopeSettings, number: int, count: int = 1) -> list[EmgPair]:
    """A movement of 8 to 16 s whose EMG comes up to 0.25 s before or after the activation, measured `count` times.

    number is the seed. The true correlation of a pair is from the other REPEATS measurements.
    """
    random = np.random.default_rng((number, NOISES.index(noise), 77))
    lag, duration = random.uniform(-0.25, 0.25), random.uniform(8.0, 16.0)
    level = _movement(number % 3, duration, random)
    time = np.arange(int(duration * MODEL_RATE)) / MODEL_RATE
    raw = _noisy_emg(noise, level(np.arange(int(duration * RATE)) / RATE - lag), random, 1 + REPEATS)
    envelopes = emg_envelope(raw, RATE, settings)[:: int(RATE / MODEL_RATE)][: len(time)]
    inner = slice(int(0.5 * MODEL_RATE), -int(0.5 * MODEL_RATE))
    smoothed = smooth(level(time), MODEL_RATE, settings.bandwidth)
    models = [np.interp(time - shift, time, smoothed)[inner] for shift in (lag, 0.0)]
    pairs = []
    for measured in range(count):
        others = np.delete(envelopes[inner], measured, axis=1)
        true = (_correlation(others, model) for model in models)
        pairs.append(EmgPair(time, envelopes[:, measured], level(time), lag, *true))
    return pairs


def compare_pair(pair: EmgPair, settings: EnvelopeSettings) -> tuple[bool, bool, float, bool]:
    """Whether the lag is identified, whether its interval contains the truth, the interval's width [s], and whether the
    interval of the correlation contains the truth.
    """
    found = compare_shapes((pair.time, pair.envelope), (pair.time, pair.activation), settings.bandwidth)
    is_known, (first, last), (low, high) = (
        found.outcome is ShapeOutcome.COMPARED,
        found.lag_ci95,
        found.correlation_ci95,
    )
    correlation = pair.correlation if is_known else pair.correlation_unshifted
    return is_known, first <= pair.lag <= last, last - first, low <= correlation <= high


def _correlation(envelopes: Array, model: Array) -> float:
    centred, others = model - model.mean(), envelopes - envelopes.mean(axis=0)
    covariance = float((centred @ others).mean()) / len(model)
    return covariance / float(model.std() * np.sqrt((others**2).mean()))


def _movement(kind: int, duration: float, random: np.random.Generator) -> Callable[[Array], Array]:
    """Level over time: a raise, three to five raises, or six bursts of any size at any time."""
    if kind == 0:
        peaks, widths, heights = random.uniform(0.35, 0.55, 1) * duration, random.uniform(0.5, 1.3, 1), np.ones(1)
    elif kind == 1:
        count = int(random.integers(3, 6))
        peaks = (np.arange(count) + 0.5 + random.uniform(-0.15, 0.15, count)) * duration / count
        widths, heights = np.full(count, duration / count / 7), random.uniform(0.7, 1.0, count)
    else:
        peaks, widths, heights = (
            random.uniform(1, duration - 1, 6),
            random.uniform(0.2, 0.6, 6),
            random.uniform(0.3, 1, 6),
        )
    bursts = list(zip(heights, peaks, widths, strict=True))
    return lambda time: 0.02 + 0.38 * np.sum([height * _burst(time, peak, width) for height, peak, width in bursts], 0)


def _burst(time: Array, peak: float, width: float) -> Array:
    return np.asarray(np.exp(-0.5 * ((time - peak) / (width * np.where(time > peak, 1.6, 1.0))) ** 2))


def _noisy_emg(noise: Noise, level: Array, random: np.random.Generator, channels: int) -> Array:
    """(n, channels) at RATE: the EMG of a level (n,) measured several times.

    "amplifier": white noise of 10 % of the peak. "gain drift": 20 % over 2 to 20 s. "disagreement": muscle and model
    differ by 10 % of the peak over 1 to 10 s. "few motor units": action potentials at random times. "stationary
    disagreement", "stationary gain drift": the same spectra, of a Gaussian process.
    """
    peak, count = float(level.max()), len(level)
    if noise == "few motor units":
        discharges = random.poisson((UNIT_RATE / RATE * (level / peak) ** 2)[:, None], (count, channels))
        time = np.arange(-30, 31) / RATE
        potential = -time * np.exp(-((time / 0.004) ** 2))
        potential /= np.sqrt((potential**2).sum() * UNIT_RATE / RATE)
        signs = random.choice([-1.0, 1.0], (count, channels))
        units = signal.fftconvolve(discharges * signs, potential[:, None], mode="same", axes=0)
        return np.asarray(peak * units + raw_emg(np.full(count, 0.02 * peak), random, channels))
    levels = np.repeat(level[:, None], channels, axis=1)
    if noise == "gain drift":
        levels *= np.exp(0.2 * sinusoids(count, channels, random, 0.05, 0.5))
    elif noise == "stationary gain drift":
        levels *= np.exp(0.2 * band_noise(count, channels, random, 0.05, 0.5))
    elif noise == "disagreement":
        levels = np.clip(levels + 0.1 * peak * sinusoids(count, channels, random, 0.1, 1.0), 0.0, None)
    elif noise == "stationary disagreement":
        levels = np.clip(levels + 0.1 * peak * band_noise(count, channels, random, 0.1, 1.0), 0.0, None)
    white = 0.1 * peak * random.standard_normal(levels.shape) if noise == "amplifier" else 0.0
    return raw_emg(levels, random, channels) + white


def sinusoids(count: int, channels: int, random: np.random.Generator, low: float, high: float) -> Array:
    """(count, channels) random curves of unit size between two frequencies [Hz].

    Eight sinusoids of random size: the mean square over 12 s has a coefficient of variation of 56 %.
    """
    shape = (8, 1, channels)
    frequencies, phases = random.uniform(low, high, shape), random.uniform(0, 2 * np.pi, shape)
    weights = random.standard_normal(shape) / 2
    return _sum(weights * np.exp(1j * (phases - np.pi / 2)), frequencies, count)


def band_noise(count: int, channels: int, random: np.random.Generator, low: float, high: float) -> Array:
    """(count, channels) Gaussian noise of unit size, with a flat spectrum between two frequencies [Hz].

    The mean square over 12 s of 0.1 to 1 Hz has a coefficient of variation of 30 %.
    """
    frequencies = np.fft.rfftfreq(4 * count, 1 / RATE)
    inside = frequencies[(frequencies >= low) & (frequencies <= high)]
    amplitudes = random.standard_normal((len(inside), channels, 2)) @ np.array([1, 1j]) / np.sqrt(len(inside))
    return _sum(amplitudes[:, None], inside[:, None, None], count)


def _sum(amplitudes: NDArray[np.complex128], frequencies: Array, count: int) -> Array:
    """(count, channels) Σ Re(a exp(2πi f t)), of amplitudes (terms, 1, channels) and frequencies [Hz] likewise.

    The exponential of a time is that of its block times that of its place in the block: 100 times fewer of them.
    """
    block = 100
    starts, places = np.arange(0, count, block) / RATE, np.arange(block) / RATE
    starting, placed = (np.exp(2j * np.pi * frequencies * time[:, None]) for time in (starts, places))
    starting, placed = np.transpose(amplitudes * starting, (2, 1, 0)), np.transpose(placed, (2, 0, 1))
    left = np.concatenate((starting.real, -starting.imag), axis=2)
    right = np.concatenate((placed.real, placed.imag), axis=1)
    blocks = np.ascontiguousarray(left) @ np.ascontiguousarray(right)  # by BLAS, eight times as fast
    return np.asarray(blocks.reshape(len(blocks), -1).T[:count])
