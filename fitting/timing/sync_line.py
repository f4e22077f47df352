"""The recorded sync line → the two edges of the capture, and every irregularity of the line."""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from fitting.quality import UnusableTrial
from fitting.timing.clocks import SyncEdges

BOUNCE = 0.02
"""Seconds: crossings of the threshold that follow each other sooner are one edge, a shorter pulse is a glitch."""
REST = 1.5
"""Seconds of low line before the edge that the station's pre-roll of 2 s leaves, whatever the blocks' bounds."""
NO_STOP = (
    "the sync line has not fallen when the recording ends: the start edge alone gives the time, and the clock ratio is "
    "assumed to be 0 ± 50 ppm; let the capture end before the recording"
)


def find_edges(time: NDArray[np.float64], level: NDArray[np.float64], threshold: float) -> SyncEdges:
    """The start and the stop edge of the capture, with findings for glitches, bounces, an early or a missing edge.

    time (n,) [s] on the DAQ clock, level (n,) and threshold in volts. Raises UnusableTrial where the line has no
    single start: it never rises, starts high, is inverted, or holds more than one pulse.
    """
    if not len(level) or not np.isfinite(level).all():
        raise UnusableTrial("the sync line holds no finite samples; check the sync channel's wiring and record again")
    pulses = _pulses(time, level >= threshold)
    if not pulses:
        raise UnusableTrial(
            f"the sync line never rises above {threshold:g} V (highest {level.max():.2f} V); check the cable from "
            "QTM's sync output and sync.threshold_v"
        )
    if pulses[0].first == 0:
        _refuse_high_start(time, level, threshold, pulses)
    long = [pulse for pulse in pulses if pulse.lasts(time) >= BOUNCE] or pulses
    if len(long) > 1:
        at = ", ".join(f"{time[pulse.first]:.2f} s" for pulse in long[:5])
        raise UnusableTrial(
            f"the sync line rises {len(long)} times (at {at}), expected once; set QTM's output to one pulse for the "
            "whole capture and record again"
        )
    capture = long[0]
    findings = _glitches(time, [pulse for pulse in _short(time, pulses) if pulse is not capture], capture)
    if time[capture.first] - time[0] < REST:
        findings += (
            f"early edge: the sync line rises {time[capture.first] - time[0]:.2f} s after its first sample, expected 2 "
            "s of rest before it; start the capture only when the station is armed",
        )
    rising, rising_sd = _between_samples(time, capture.first)
    return replace(_with_fall(time, capture, findings), rising=rising, rising_sd=rising_sd)


def find_fall(time: NDArray[np.float64], level: NDArray[np.float64], threshold: float) -> SyncEdges:
    """The fall of a line that was high from sample 0 on, where the edge itself started the acquisition (PFI)."""
    pulses = _pulses(time, level >= threshold)
    if not pulses or pulses[0].first > 0:
        return SyncEdges(0.0, 0.0, None, findings=("the sync line is low where the capture began; check its cable",))
    return _with_fall(time, pulses[0], _glitches(time, _short(time, pulses[1:]), pulses[0]))


@dataclass(frozen=True)
class _Pulse:
    """A stretch of high line: its first sample, the first low one after it (None: stays high), and the dips in it.

    dips are (first low sample, first high sample again), each shorter than BOUNCE.
    """

    first: int
    after: int | None
    dips: tuple[tuple[int, int], ...] = ()

    def lasts(self, time: NDArray[np.float64]) -> float:
        return np.inf if self.after is None else float(time[self.after] - time[self.first])


def _pulses(time: NDArray[np.float64], is_high: NDArray[np.bool_]) -> list[_Pulse]:
    """The stretches of high line; what parts them for less than BOUNCE is a dip in one."""
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
    """Refuse a line that starts high: inverted if it is low during the capture only, else the capture ran already."""
    starts = f"the sync line starts at {level[0]:.2f} V, expected below {threshold:g} V until the capture starts"
    gaps = [float(time[after.first] - time[before.after or 0]) for before, after in pairwise(pulses)]
    if len(gaps) == 1 and pulses[1].after is None:
        fell = float(time[pulses[0].after or 0])
        raise UnusableTrial(
            f"wrong polarity: {starts}, and is low for {gaps[0]:.2f} s from {fell:.2f} s on; set QTM's output to "
            "active high, or swap the two wires"
        )
    raise UnusableTrial(
        f"{starts}; check that QTM's output is active high and that the station is armed before the capture"
    )


def _glitches(time: NDArray[np.float64], spikes: list[_Pulse], capture: _Pulse) -> tuple[str, ...]:
    """Findings on what was ignored: spikes beside the capture, dips within it, bounces at its edges."""
    edges = [time[capture.first], *([] if capture.after is None else [time[capture.after]])]
    at_edge = [dip for dip in capture.dips if min(abs(time[dip[0]] - edge) for edge in edges) <= BOUNCE]
    dips = [dip for dip in capture.dips if dip not in at_edge]
    found: tuple[str, ...] = ()
    for what, starts in (
        ("bounce: the sync line crosses its threshold again at an edge", [dip[0] for dip in at_edge]),
        ("glitch: the sync line is low during the capture", [dip[0] for dip in dips]),
        ("glitch: the sync line is high beside the capture", [spike.first for spike in spikes]),
    ):
        if starts:
            at = ", ".join(f"{time[start]:.3f} s" for start in starts[:3]) + (", …" if len(starts) > 3 else "")
            found += (f"{what} {len(starts)} time(s) for less than 20 ms, at {at}; ignored, check the cable",)
    return found


def _with_fall(time: NDArray[np.float64], capture: _Pulse, findings: tuple[str, ...]) -> SyncEdges:
    """The stop edge: the first fall of those that bounce together at the pulse's end."""
    if capture.after is None:
        return SyncEdges(0.0, 0.0, None, findings=(*findings, NO_STOP))
    end = time[capture.after]
    first = min([fell for fell, _ in capture.dips if end - time[fell] <= BOUNCE], default=capture.after)
    if time[first] - time[capture.first] < BOUNCE:
        short = f"no stop edge: the sync line is high for {1e3 * capture.lasts(time):.0f} ms only, not for the capture"
        return SyncEdges(0.0, 0.0, None, findings=(*findings, f"{short}; set QTM's output to measurement time"))
    return SyncEdges(0.0, 0.0, *_between_samples(time, first), findings=findings)


def _between_samples(time: NDArray[np.float64], first_after: int) -> tuple[float, float]:
    """The middle [s] of the two samples around an edge, and the standard uncertainty [s] of the edge's place."""
    before, after = float(time[first_after - 1]), float(time[first_after])
    return (before + after) / 2, (after - before) / np.sqrt(12)
