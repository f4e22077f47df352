"""What an operator should know of a trial's two sync edges, in sentences."""

from __future__ import annotations

from fitting.timing.clock_fit import ClockFit
from fitting.timing.clocks import CRYSTAL_LIMIT, LARGEST_DRIFT

PPM = 1e6


def early_notes(early: float) -> tuple[str, ...]:
    """A note where the sync line rose before the first frame was exposed, by `early` [s]."""
    if not early:
        return ()
    return (
        f"early edge: the sync line rose {early:.2f} s before the first frame, by the frames' number and by their "
        "arrival; the lag is uncertain by as much, set QTM's sync output to measurement time",
    )


def stop_notes(falling: float | None, clock: ClockFit, contradiction: float) -> tuple[str, ...]:
    """A note where the stop edge leaves the clock ratio open, or contradicts the number of frames [s]."""
    if falling is None:
        return ()
    if contradiction:
        when = "before the last frame" if contradiction < 0 else "between two frames"
        return (
            f"stop edge and number of frames disagree: the sync line fell {1e3 * abs(contradiction):.1f} ms {when}, "
            f"more than clocks {PPM * LARGEST_DRIFT:.0f} ppm apart explain; the lag is uncertain by as much, check "
            "QTM's frame rate and its sync output",
        )
    if not clock.has_both_edges:
        return (
            "the sync line fell several frames after the last received one: frames are missing at the end; the start "
            "edge alone gives the time",
        )
    if clock.missing_frames:
        return (
            "clock ratio not identified: the stop edge needs a drift beyond that of crystals "
            f"({PPM * CRYSTAL_LIMIT:.0f} ppm), or {clock.missing_frames} missing frame(s) at the end; record a trial "
            "of another duration to distinguish the two",
        )
    if not clock.is_identified:
        return (
            "clock ratio not identified: the capture is too short for the sampling interval and the stop edge's "
            f"position in the last frame, which allow more than ±{PPM * LARGEST_DRIFT:.0f} ppm; record longer, or "
            "declare sync.stop_edge (docs/calibration.md)",
        )
    return ()
