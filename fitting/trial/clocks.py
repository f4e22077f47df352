"""Common clock of both devices: session time 0 is the rising edge of /sync, in seconds of the mocap system.

The edges of the capture are found on the recorded sync line, with every irregularity of the line. The DAQ's clock is
fitted to the mocap system's from the start and the stop edge."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from recordings.manifest import Timing

DECLARED = "declared"
DRIFT_PRIOR_SD = 50e-6
"""Standard uncertainty of the ratio of two clocks with crystals, assumed if it is not measured."""
CRYSTAL_LIMIT = 3 * DRIFT_PRIOR_SD
"""Largest drift of two crystals. If the stop edge needs more, missing frames are considered too."""
LARGEST_DRIFT = 500e-6
"""Largest possible drift, for example of a DAQ without a crystal. Estimates are limited to it."""
HOST_TOLERANCE = 0.5
"""Tolerance of host arrival against frame numbers [s]; a 30× simulation turns 10 ms of wall time into 0.3 s."""
HOST_ALIGNMENT_SD = 0.05
STAMP_TOLERANCE = 1.5
"""Tolerated difference between the steps of frame number and time stamp within a capture [frames]."""


@dataclass(frozen=True)
class SyncEdges:
    """The edges of the capture on the sync line, in seconds of the DAQ clock.

    rising_sd and falling_sd are the standard uncertainties of the edges, which lie between two samples: a uniform
    distribution √12 times as wide. falling is None if the line never fell. findings are irregularities of the line.
    """

    rising: float
    rising_sd: float
    falling: float | None
    falling_sd: float = 0.0
    findings: tuple[Note, ...] = ()


@dataclass(frozen=True)
class LagUncertainty:
    """Lag of force against markers, already applied to the times of the force, and its standard uncertainty.

    edge      [s] independent in every trial: position of its edges between two samples, at the middle of the trial
    declared  [s] common to all trials: delays, as declared or as calibrated by a bounce trial
    drift     [s/s] common to all trials: ratio of the clocks, 0 if two edges measured it
    since     [s] session time at which drift has no effect: the edge, or the middle of the bounce trial
    value     [s] a force sample stamped t was taken at t + value; already in the trial's times
    source    of the value: "declared", or the bounce trials' files
    """

    edge: float
    declared: float
    drift: float
    since: float = 0.0
    value: float = 0.0
    source: str = DECLARED

    def common(self, time: float) -> float:
        """The part common to all trials [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.declared, self.drift * (time - self.since))

    def total(self, time: float) -> float:
        """The whole standard uncertainty [s], for a record centred at session time `time` [s]."""
        return math.hypot(self.edge, self.common(time))


def capture_frames(
    numbers: NDArray[np.int64],
    device_time: NDArray[np.float64],
    host_time: NDArray[np.float64],
    rate: float,
    edge_host: float,
) -> slice:
    """The received frames (n,) that are the capture; those before and after it are live preview.

    QTM restarts its frame numbers when a capture starts, and they jump when it ends, while its time stamps [s] may
    continue or restart. So the frames are divided into runs in which the steps of numbers and stamps agree. The capture
    is the run whose frame 1, extrapolated from its numbers, arrived nearest to the edge on the host's clock [s].
    """
    bounds = [0, *_breaks(numbers, device_time * rate), len(numbers)]
    runs = [slice(first, last) for first, last in pairwise(bounds)]
    return min(runs, key=lambda run: abs(arrival_offset(host_time[run], (numbers[run] - 1) / rate) - edge_host))


def arrival_offset(host_time: NDArray[np.float64], device_time: NDArray[np.float64]) -> float:
    """Host time minus device time [s] of the sample with the least delay."""
    return float(np.min(host_time - device_time))


def _breaks(numbers: NDArray[np.int64], stamps: NDArray[np.float64]) -> list[int]:
    """Indices at which a new run begins: numbers decrease, or their steps differ from those of the stamps [frames]."""
    number_steps, stamp_steps = np.diff(numbers), np.diff(stamps)
    apart = np.abs(number_steps - stamp_steps)
    is_break = number_steps < 0
    if len(apart) and np.median(apart) < 0.5:  # otherwise the stamps are constant or have another unit
        is_break |= apart > STAMP_TOLERANCE
    return [int(index) + 1 for index in np.flatnonzero(is_break)]


LONGEST_FORCE_GAP = 0.05
"""Seconds without force that are interpolated; of a pull once a second, 1 % of the amplitude is lost. Frames in longer
gaps are left out as if they were hidden."""
BOUNCE = 0.02
"""Seconds: threshold crossings within this time are one edge; a shorter pulse is a glitch."""
REST = 1.5
"""Least time [s] of low line before the edge; the station's pre-roll is 2 s, minus up to a block."""


def find_edges(time: NDArray[np.float64], level: NDArray[np.float64], threshold: float) -> SyncEdges:
    """The start and the stop edge of the capture, with findings on glitches, bounces, an early or a missing edge.

    time (n,) [s] on the DAQ clock, level (n,) and threshold in volts. Raises UnusableTrial if the line has no unique
    start: it never rises, starts high, is inverted, or has more than one pulse.
    """
    if not len(level) or not np.isfinite(level).all():
        raise UnusableTrial(RejectionCode.SYNC_NOT_FINITE)
    pulses = _pulses(time, level >= threshold)
    if not pulses:
        figures = {"threshold_v": threshold, "highest_v": float(level.max())}
        raise UnusableTrial(RejectionCode.SYNC_NEVER_RISES, figures)
    if pulses[0].first == 0:
        _refuse_high_start(time, level, threshold, pulses)
    long = [pulse for pulse in pulses if pulse.lasts(time) >= BOUNCE] or pulses
    if len(long) > 1:
        at = ", ".join(f"{time[pulse.first]:.2f} s" for pulse in long[:5])
        raise UnusableTrial(RejectionCode.SYNC_RISES_AGAIN, {"count": len(long), "at": at})
    capture = long[0]
    findings = _glitches(time, [pulse for pulse in _short(time, pulses) if pulse is not capture], capture)
    rest = float(time[capture.first] - time[0])
    if rest < REST:
        findings += (Note(TrialNoteCode.SYNC_EARLY, {"rest_s": rest}),)
    rising, rising_sd = _between_samples(time, capture.first)
    return replace(_with_fall(time, capture, findings), rising=rising, rising_sd=rising_sd)


def find_fall(time: NDArray[np.float64], level: NDArray[np.float64], threshold: float) -> SyncEdges:
    """The falling edge of a line that is high from sample 0, because the rising edge started the acquisition (PFI)."""
    pulses = _pulses(time, level >= threshold)
    if not pulses or pulses[0].first > 0:
        return SyncEdges(0.0, 0.0, None, findings=(Note(TrialNoteCode.SYNC_LOW),))
    return _with_fall(time, pulses[0], _glitches(time, _short(time, pulses[1:]), pulses[0]))


@dataclass(frozen=True)
class _Pulse:
    """A stretch of high line: its first sample, the first low one after it (None: stays high), and its dips.

    dips are (first low sample, next high sample), all shorter than BOUNCE.
    """

    first: int
    after: int | None
    dips: tuple[tuple[int, int], ...] = ()

    def lasts(self, time: NDArray[np.float64]) -> float:
        return np.inf if self.after is None else float(time[self.after] - time[self.first])


def _pulses(time: NDArray[np.float64], is_high: NDArray[np.bool_]) -> list[_Pulse]:
    """The stretches of high line; an interruption shorter than BOUNCE is a dip."""
    steps = np.diff(np.concatenate(([0], is_high.astype(np.int8), [0])))
    pulses: list[_Pulse] = []
    for first, after in zip(np.flatnonzero(steps == 1).tolist(), np.flatnonzero(steps == -1).tolist(), strict=True):
        end = after if after < len(time) else None
        last = pulses[-1] if pulses else None
        if last is not None and last.after is not None and time[first] - time[last.after] < BOUNCE:
            pulses[-1] = replace(last, after=end, dips=(*last.dips, (last.after, first)))
        else:
            pulses.append(_Pulse(first, end))
    return pulses


def _short(time: NDArray[np.float64], pulses: list[_Pulse]) -> list[_Pulse]:
    return [pulse for pulse in pulses if pulse.lasts(time) < BOUNCE]


def _refuse_high_start(
    time: NDArray[np.float64], level: NDArray[np.float64], threshold: float, pulses: list[_Pulse]
) -> None:
    """Refuse a line that starts high: inverted if it is low only once, otherwise the capture was already running."""
    figures = {"level_v": float(level[0]), "threshold_v": threshold}
    first, *later = pulses
    if first.after is not None and len(later) == 1 and later[0].after is None:
        fell = float(time[first.after])
        gap = float(time[later[0].first]) - fell
        raise UnusableTrial(RejectionCode.SYNC_INVERTED, {**figures, "gap_s": gap, "fell_s": fell})
    raise UnusableTrial(RejectionCode.SYNC_STARTS_HIGH, figures)


def _glitches(time: NDArray[np.float64], spikes: list[_Pulse], capture: _Pulse) -> tuple[Note, ...]:
    """Findings on ignored crossings: spikes outside the capture, dips within it, bounces at its edges."""
    edges = [time[capture.first], *([] if capture.after is None else [time[capture.after]])]
    at_edge = [dip for dip in capture.dips if min(abs(time[dip[0]] - edge) for edge in edges) <= BOUNCE]
    dips = [dip for dip in capture.dips if dip not in at_edge]
    found: tuple[Note, ...] = ()
    for code, starts in (
        (TrialNoteCode.SYNC_BOUNCES, [dip[0] for dip in at_edge]),
        (TrialNoteCode.SYNC_DIPS, [dip[0] for dip in dips]),
        (TrialNoteCode.SYNC_SPIKES, [spike.first for spike in spikes]),
    ):
        if starts:
            at = ", ".join(f"{time[start]:.3f} s" for start in starts[:3]) + (", …" if len(starts) > 3 else "")
            found += (Note(code, {"count": len(starts), "at": at}),)
    return found


def _with_fall(time: NDArray[np.float64], capture: _Pulse, findings: tuple[Note, ...]) -> SyncEdges:
    """The stop edge: the first fall of the bounces at the end of the pulse."""
    if capture.after is None:
        return SyncEdges(0.0, 0.0, None, findings=(*findings, Note(TrialNoteCode.SYNC_NO_STOP)))
    end = time[capture.after]
    first = min([fell for fell, _ in capture.dips if end - time[fell] <= BOUNCE], default=capture.after)
    if time[first] - time[capture.first] < BOUNCE:
        short = Note(TrialNoteCode.SYNC_SHORT, {"duration_s": capture.lasts(time)})
        return SyncEdges(0.0, 0.0, None, findings=(*findings, short))
    return SyncEdges(0.0, 0.0, *_between_samples(time, first), findings=findings)


def _between_samples(time: NDArray[np.float64], first_after: int) -> tuple[float, float]:
    """The middle [s] of the two samples around an edge, and the standard uncertainty [s] of its time."""
    before, after = float(time[first_after - 1]), float(time[first_after])
    return (before + after) / 2, (after - before) / np.sqrt(12)


DRIFT_CELLS, START_CELLS = 800, 64
"""Cells of the grid on which the posterior is evaluated; this resolves 0.1 % of a sample."""


@dataclass(frozen=True)
class StopWindow:
    """The interval in which the stop edge lies, in seconds from the end of the last frame, with a uniform density.

    earliest, latest  [s] negative before the end of the frame
    frame             [s] the frame period
    is_declared       whether the configuration states the position; otherwise every position in the interval is equally
                      likely, and may be the same in all trials
    """

    earliest: float
    latest: float
    frame: float
    is_declared: bool

    def shifted(self, frames: int) -> StopWindow:
        """The same window, `frames` frames later."""
        later = frames * self.frame
        return replace(self, earliest=self.earliest + later, latest=self.latest + later)


def stop_window(timing: Timing, frame: float) -> StopWindow:
    """The window that the manifest declares, for a frame period of `frame` [s].

    Qualisys documents that the output MEASUREMENT TIME stays high "until the end of the last frame", which may be the
    end of its exposure or of its period. So any position in the last frame is possible, unless sync.stop_edge is set.
    """
    if timing.stop_edge == "end_of_frame":
        return StopWindow(0.0, 0.0, frame, is_declared=True)
    if timing.stop_edge == "end_of_exposure" and timing.exposure_s is not None:
        before_end = timing.exposure_s - frame
        return StopWindow(before_end, before_end, frame, is_declared=True)
    if timing.stop_edge == "anywhere":
        return StopWindow(-frame, 0.0, frame, is_declared=True)
    return StopWindow(-frame, 0.0, frame, is_declared=False)


@dataclass(frozen=True)
class SyncErrors:
    """Largest error of the time in a trial, and the resulting errors at the highest rates of change.

    time [s], force [N], displacement [m]: standard uncertainties
    """

    time: float
    force: float
    displacement: float


@dataclass(frozen=True)
class ClockFit:
    """The DAQ's clock relative to the mocap system's: DAQ time = start + ratio × session time.

    start           [s] of the DAQ's clock when the capture began
    ratio           DAQ seconds per mocap second
    covariance      (2, 2) of (start, ratio)
    has_both_edges  whether the stop edge was used
    drift_ci95      95 % interval of ratio − 1; None if the stop edge was not used
    is_identified   whether this interval is measured, and not limited by the largest possible drift
    common_drift    part of the ratio's standard uncertainty that may be common to all trials
    missing_frames  frames possibly missing at the end, if the ratio would otherwise exceed that of crystals
    """

    start: float
    ratio: float
    covariance: NDArray[np.float64]
    has_both_edges: bool
    drift_ci95: tuple[float, float] | None = None
    is_identified: bool = False
    common_drift: float = 0.0
    missing_frames: int = 0

    def session_time(self, daq_time: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n,) [s] on the DAQ's clock → (n,) s since the edge on the mocap system's."""
        return np.asarray((daq_time - self.start) / self.ratio)

    def time_sd(self, time: float) -> float:
        """Standard uncertainty [s] of a session time [s] that was read from the DAQ's clock."""
        lever = np.array([1.0, time])
        return math.sqrt(max(0.0, float(lever @ self.covariance @ lever)))

    def largest_time_sd(self, duration: float) -> float:
        """Largest standard uncertainty [s] of the time in a trial of `duration` [s]."""
        return max(self.time_sd(0.0), self.time_sd(duration))


def fit_clock(edges: SyncEdges, capture: float | None, stop: StopWindow) -> ClockFit:
    """Start of the capture and rate of the DAQ's clock.

    capture [s] is the duration of the received frames on the mocap system's clock, None if unknown. Priors are uniform:
    the edges between two samples, the stop edge in its window, the drift up to LARGEST_DRIFT. Without a stop edge, or
    with one that no possible drift explains, the drift is assumed to be 0 ± DRIFT_PRIOR_SD.
    """
    if edges.falling is None or not capture or capture < 0:
        return _one_edge(edges)
    record = _Record(edges, capture, edges.falling - edges.rising - capture)
    interval = _interval(record, stop, 0)
    if interval[0] >= LARGEST_DRIFT or interval[1] <= -LARGEST_DRIFT:
        return _one_edge(edges)
    if missing := _missing_frames(record, stop):
        interval = _interval(record, stop, missing)
    is_cut = interval[0] < -LARGEST_DRIFT or interval[1] > LARGEST_DRIFT
    interval = max(interval[0], -LARGEST_DRIFT), min(interval[1], LARGEST_DRIFT)
    window = replace(stop, latest=stop.shifted(missing).latest)
    fit = record.moments(window)
    shared = 0.0 if stop.is_declared and not missing else (window.latest - window.earliest) / capture / math.sqrt(12)
    return replace(
        fit,
        drift_ci95=interval,
        is_identified=not is_cut and not missing,
        common_drift=min(shared, math.sqrt(fit.covariance[1, 1])),
        missing_frames=missing,
    )


def stop_contradiction(edges: SyncEdges, capture: float, stop: StopWindow) -> float:
    """Seconds by which the stop edge contradicts frames that last `capture` [s]; 0 without a contradiction.

    A contradiction is not explained by any drift up to LARGEST_DRIFT. It is negative if the line fell before the last
    frame was taken. If it fell later, whole frames may be missing, and only the remainder is a contradiction.
    """
    if edges.falling is None:
        return 0.0
    excess = edges.falling - edges.rising - capture
    tolerance = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    if excess > stop.latest + tolerance:
        excess -= stop.frame * round(excess / stop.frame)
    return excess if not stop.earliest - tolerance <= excess <= stop.latest + tolerance else 0.0


def early_edge(edges: SyncEdges, capture: float, frame: float, late: float) -> float:
    """Seconds by which the line rose before frame 1 was exposed; 0 without an indication of it.

    The frames, with a period of `frame` [s], last `capture` [s]. If this is shorter than the pulse, frames are missing
    at its start or its end. They are missing at the start if frame 1 arrived at the host late [s] by more than half of
    the difference. A difference that drift explains does not count.
    """
    short = 0.0 if edges.falling is None else edges.falling - edges.rising - capture
    explained = LARGEST_DRIFT * capture + math.sqrt(3) * (edges.rising_sd + edges.falling_sd)
    return short if short > max(frame / 2, explained) and late > short / 2 else 0.0


def _one_edge(edges: SyncEdges) -> ClockFit:
    return ClockFit(edges.rising, 1.0, np.diag([edges.rising_sd**2, DRIFT_PRIOR_SD**2]), has_both_edges=False)


def _missing_frames(record: _Record, stop: StopWindow) -> int:
    """Least number of missing frames with which the drift is that of crystals; 0 if none are needed or none suffice."""
    lowest, _ = record.support(stop)
    count = math.ceil((lowest - CRYSTAL_LIMIT) * record.capture / stop.frame)
    _, highest = record.support(stop.shifted(count))
    return count if count > 0 and highest >= -CRYSTAL_LIMIT else 0


@dataclass(frozen=True)
class _Record:
    """Both edges, the duration of the frames [s], and duration of the pulse minus that of the frames [s]."""

    edges: SyncEdges
    capture: float
    excess: float

    @property
    def _widths(self) -> tuple[float, float]:
        """Sampling intervals around the rising and the falling edge [s]."""
        return math.sqrt(12) * self.edges.rising_sd, max(math.sqrt(12) * self.edges.falling_sd, 1e-9)

    def support(self, stop: StopWindow) -> tuple[float, float]:
        """Lowest and highest drift that is compatible with the edges."""
        reach = sum(self._widths) / 2
        return (self.excess - stop.latest - reach) / self.capture, (self.excess - stop.earliest + reach) / self.capture

    def moments(self, stop: StopWindow) -> ClockFit:
        """Posterior means and covariance of start and ratio, with the drift within LARGEST_DRIFT."""
        low, high = (min(max(end, -LARGEST_DRIFT), LARGEST_DRIFT) for end in self.support(stop))
        drifts, starts, density = self._posterior(stop, low, high)
        of_drift, of_start = density.sum(axis=1), density.sum(axis=0)
        drift, start = float(of_drift @ drifts), float(of_start @ starts)
        off_drift, off_start = drifts - drift, starts - start
        shared = float(off_drift @ density @ off_start)
        cells = (high - low) / DRIFT_CELLS, self._widths[0] / START_CELLS
        variances = [float(of_start @ off_start**2) + cells[1] ** 2 / 12, float(of_drift @ off_drift**2)]
        covariance = np.array([[variances[0], shared], [shared, variances[1] + cells[0] ** 2 / 12]])
        return ClockFit(self.edges.rising + start, 1 + drift, covariance, has_both_edges=True)

    def quantiles(self, stop: StopWindow, *parts: float) -> tuple[float, ...]:
        """Quantiles of the posterior of the drift."""
        low, high = self.support(stop)
        _, _, density = self._posterior(stop, low, high)
        cumulated = np.append(0.0, np.cumsum(density.sum(axis=1)))
        return tuple(np.interp(parts, cumulated, np.linspace(low, high, DRIFT_CELLS + 1)).tolist())

    def _posterior(
        self, stop: StopWindow, low: float, high: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Drifts (n,), starts (m,) [s] after the middle of the rising edge, and their probabilities (n, m).

        excess + fall − start = drift capture + stop, where fall is the position of the stop edge between its two
        samples, and stop its position in the window. The density is the length of the intersection of both intervals.
        """
        rise, fall = self._widths
        drifts = low + (np.arange(DRIFT_CELLS) + 0.5) / DRIFT_CELLS * (high - low)
        starts = rise * ((np.arange(START_CELLS) + 0.5) / START_CELLS - 0.5)
        stops = self.excess - starts[None, :] - drifts[:, None] * self.capture  # for a fall at its middle
        latest = max(
            stop.latest, stop.earliest + 1e-3 * fall
        )  # a window without width becomes a thousandth of a sample
        density = np.minimum(latest, stops + fall / 2) - np.maximum(stop.earliest, stops - fall / 2)
        density = np.maximum(density, 0.0)
        return drifts, starts, density / density.sum()


def _interval(record: _Record, stop: StopWindow, missing: int) -> tuple[float, float]:
    """95 % interval of the drift.

    Central for a declared window. If two positions of the stop edge cannot be distinguished (both ends of a window that
    is not declared, or all frames received and some missing), the interval covers both, with 95 % for either.
    """
    early, late = stop, stop.shifted(missing)
    if not stop.is_declared:
        early, late = replace(early, latest=early.earliest), replace(late, earliest=late.latest)
    if early == late:
        low, high = record.quantiles(stop, 0.025, 0.975)
    else:
        (low,), (high,) = record.quantiles(late, 0.05), record.quantiles(early, 0.95)
    return low, high


def early_notes(early: float) -> tuple[Note, ...]:
    """A note if the sync line rose `early` [s] before the first frame was exposed."""
    return (Note(TrialNoteCode.SYNC_BEFORE_FRAMES, {"early_s": early}),) if early else ()


def stop_notes(falling: float | None, clock: ClockFit, contradiction: float) -> tuple[Note, ...]:
    """A note if the stop edge does not determine the clock ratio, or contradicts the number of frames [s]."""
    if falling is None:
        return ()
    if contradiction:
        name = "before_end_s" if contradiction < 0 else "between_frames_s"
        return (Note(TrialNoteCode.SYNC_CONTRADICTION, {name: abs(contradiction), "limit": LARGEST_DRIFT}),)
    if not clock.has_both_edges:
        return (Note(TrialNoteCode.SYNC_MISSING_FRAMES),)
    if clock.missing_frames:
        figures = {"limit": CRYSTAL_LIMIT, "frames": clock.missing_frames}
        return (Note(TrialNoteCode.CLOCKS_OR_FRAMES, figures),)
    if not clock.is_identified:
        return (Note(TrialNoteCode.CLOCKS_OPEN, {"limit": LARGEST_DRIFT}),)
    return ()
