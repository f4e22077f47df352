"""Find the two edges of the capture on the recorded sync line, and every irregularity of the line."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.clocks import SyncEdges

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
