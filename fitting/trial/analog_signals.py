"""EMG and other analog inputs of a wearer's trial on session time, in volts.

Inputs of the DAQ share the clock of the force. An amplifier with its own clock (Lab Streaming Layer) is aligned by the
sync line if it records this line, and otherwise by the clock offsets that were measured during streaming.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from documents.message import Figures, because
from fitting.errors import UnusableTrial
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.clocks import HOST_ALIGNMENT_SD, arrival_offset, find_edges
from fitting.trial.timeline import Timeline
from recordings.manifest import EmgAmplifier, Manifest
from recordings.reader import Track
from recordings.topics import ANALOG, EMG, EMG_CLOCK, EMG_SYNC

Floats = NDArray[np.float64]

CLOCK_JUMP = 0.1
"""Seconds between two samples; the stamps of an amplifier jitter by tens of milliseconds."""
RATE_TOLERANCE = 0.01
VOLTS = {"V": 1.0, "mV": 1e-3, "uV": 1e-6}


@dataclass(frozen=True, eq=False)
class AnalogSignals:
    """The channels of one stream between the sync edge and the last frame.

    time     (n,) s since the sync edge, without lost samples;  values (n, channels) in unit
    unit     "V": EMG at the electrodes, other inputs at the input; or the device's own unit if it is not a voltage
    rate     Hz, nominal;  numbers (n,) of the samples
    time_sd  standard uncertainty [s] common to all times;  notes on it
    """

    labels: tuple[str, ...]
    unit: str
    rate: float
    numbers: NDArray[np.int64]
    time: Floats
    values: Floats
    time_sd: float
    notes: tuple[Note, ...] = ()

    def __post_init__(self) -> None:
        for array in (self.numbers, self.time, self.values):
            array.setflags(write=False)

    def gaps(self) -> tuple[tuple[float, float], ...]:
        """(start, end) s of lost samples, from gaps in their numbers."""
        jumps = np.flatnonzero(np.diff(self.numbers) > 1)
        return tuple((float(self.time[i]), float(self.time[i + 1])) for i in jumps)


def build_analog_signals(
    manifest: Manifest, tracks: Mapping[str, Track], timeline: Timeline
) -> dict[str, AnalogSignals]:
    """The streams "/emg" and "/analog" of a recording, by name; timeline is that of its force and markers."""
    found: dict[str, AnalogSignals] = {}
    for name in (EMG, ANALOG):
        if name not in tracks or not len(tracks[name].sample_numbers):
            continue
        amplifier = manifest.emg if name == EMG and manifest.emg is not None else EmgAmplifier("daq", lag_sd_s=0.0)
        times = _daq_times(tracks[name], timeline)
        if amplifier.source == "lsl":
            times = _amplifier_times(amplifier, tracks, timeline)
        found[name] = _cut(tracks[name], amplifier, times, float(timeline.marker_time[-1]))
    return found


def nearest_samples(times: Floats, wanted: Floats) -> NDArray[np.int64]:
    """Indices (m,) of the samples nearest to the wanted times (m,); the times (n,) of the samples increase."""
    after = np.clip(np.searchsorted(times, wanted), 1, len(times) - 1)
    is_before = wanted - times[after - 1] < times[after] - wanted
    return np.asarray(after - is_before, dtype=np.int64)


@dataclass(frozen=True)
class _Times:
    """Session times (n,) [s] of the samples of a track, before the correction of its lag."""

    time: Floats
    sd: float
    notes: tuple[Note, ...] = ()


def _cut(track: Track, amplifier: EmgAmplifier, times: _Times, end: float) -> AnalogSignals:
    """The samples from the sync edge to `end` [s], in volts."""
    stream = track.stream
    gains = np.array([amplifier.gains.get(label, 1.0) for label in stream.labels])
    time = times.time + amplifier.lag_s
    kept = (time >= 0.0) & (time <= end)
    return AnalogSignals(
        labels=stream.labels,
        unit="V" if stream.unit in VOLTS else stream.unit,
        rate=stream.rate_hz,
        numbers=track.sample_numbers.astype(np.int64)[kept],
        time=time[kept],
        values=(track.values * (VOLTS.get(stream.unit, 1.0) / gains))[kept],
        time_sd=math.hypot(times.sd, amplifier.lag_sd_s),
        notes=times.notes,
    )


def _daq_times(track: Track, timeline: Timeline) -> _Times:
    seconds = track.sample_numbers.astype(np.float64) / track.stream.rate_hz
    return _Times(timeline.clock.session_time(seconds), timeline.clock.time_sd(float(timeline.marker_time[-1]) / 2))


def _amplifier_times(amplifier: EmgAmplifier, tracks: Mapping[str, Track], timeline: Timeline) -> _Times:
    """Times from the sync line that the amplifier recorded, or else from the clock offsets."""
    seconds = _even_seconds(tracks[EMG])
    if amplifier.sync_threshold is None or EMG_SYNC not in tracks:
        return _times_by_offsets(tracks, timeline, seconds, Note(TrialNoteCode.EMG_NO_SYNC))
    pulse = tracks[EMG_SYNC]
    try:
        edges = find_edges(_even_seconds(pulse), pulse.values[:, 0], amplifier.sync_threshold)
    except UnusableTrial as error:
        return _times_by_offsets(tracks, timeline, seconds, error.reason)
    ratio = 1.0
    if edges.falling is not None and timeline.sync_fall is not None:
        ratio = (edges.falling - edges.rising) / timeline.sync_fall
    return _Times((seconds - edges.rising) / ratio, edges.rising_sd)


def _times_by_offsets(tracks: Mapping[str, Track], timeline: Timeline, seconds: Floats, reason: Note) -> _Times:
    """Times from the offset between the clocks of amplifier and station that has the least uncertainty.

    Raises UnusableTrial if no offset was measured.
    """
    if EMG_CLOCK not in tracks or not len(tracks[EMG_CLOCK].values):
        raise UnusableTrial(RejectionCode.EMG_NO_CLOCK, because(reason))
    offsets, sync = tracks[EMG_CLOCK], tracks["/sync"]
    jumped = np.flatnonzero(_clock_jumps(tracks[EMG]))
    before = offsets.host_time_ns <= tracks[EMG].host_time_ns[jumped[0]] if len(jumped) else np.array([False])
    usable = np.flatnonzero(before) if before.any() else np.arange(len(offsets.values))
    best = int(usable[np.argmin(offsets.values[usable, offsets.stream.labels.index("uncertainty")])])
    to_host = 1e-9 * float(offsets.host_time_ns[best] - offsets.device_time_ns[best])
    daq_seconds = sync.sample_numbers.astype(np.float64) / sync.stream.rate_hz
    edge = timeline.clock.start + arrival_offset(1e-9 * sync.host_time_ns.astype(np.float64), daq_seconds)
    figures: Figures = {"standard_error_s": HOST_ALIGNMENT_SD, **because(reason)}
    note = Note(TrialNoteCode.EMG_HOST_CLOCK, figures)
    return _Times(seconds + (to_host - edge), HOST_ALIGNMENT_SD, (note,))


def _clock_jumps(track: Track) -> Floats:
    """Jumps of the device's clock (n - 1,) [s]: steps of the stamps that contradict those of the numbers; else 0."""
    passed = np.diff(track.sample_numbers.astype(np.float64)) / track.stream.rate_hz
    jumps: Floats = 1e-9 * np.diff(track.device_time_ns.astype(np.float64)) - passed
    jumps[np.abs(jumps) <= CLOCK_JUMP + RATE_TOLERANCE * passed] = 0.0
    return jumps


def _even_seconds(track: Track) -> Floats:
    """Times (n,) [s] on the device's clock without jitter: a line through the time stamps of every run of numbers.

    A jump of the numbers begins a new run. Times after a jump of the clock are on the clock of the first sample.
    """
    numbers, stamps = track.sample_numbers.astype(np.int64), 1e-9 * track.device_time_ns.astype(np.float64)
    stamps[1:] -= np.cumsum(_clock_jumps(track))
    bounds = [0, *(np.flatnonzero(np.diff(numbers) != 1) + 1).tolist(), len(numbers)]
    seconds = stamps.copy()
    for first, last in pairwise(bounds):
        if last - first > 2:
            count = numbers[first:last] - numbers[first]
            middle = count.mean()
            slope = np.sum((count - middle) * (stamps[first:last] - stamps[first])) / np.sum((count - middle) ** 2)
            seconds[first:last] = stamps[first:last].mean() + slope * (count - middle)
    return seconds
