"""When not to believe a trial, in sentences: what makes it unusable is raised, what makes it doubtful is a note."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fitting.calibration import code_width
from fitting.errors import FitError

MIN_ANCHOR_MARKERS = 3
MIN_ANCHOR_WIDTH = 5e-3
"""Second singular value [m] of the anchor cluster below which rotation about its line is not defined."""
OCCLUSION_NOTE = 0.2
OCCLUSION_LIMIT = 0.5
SKIN_CORRELATION = 0.3
LEAN_NOTE = 5e-3
STUCK = 1.0
MOVES_ON = 0.2
"""Part of its way by which the cuff may move under a load that is held, creeping or slipping."""
QUIETER, BEYOND_CHANCE = 10, 1e-9
"""Per cent of a record's seconds that have less noise than what is taken for it, and the chance that is none."""
REST = 1.0
"""Seconds."""
ZERO_DRIFT, ZERO_DRIFT_PART = 0.5, 0.02
"""Newtons, and part of the trial's range: the larger is what the zero may drift without a note."""
MOST_DISPLACEMENT, LEAST_DISPLACEMENT = 1.0, 1e-6


class UnusableTrial(FitError):
    """The trial cannot be fitted; one sentence says who, what was expected, what was found, and what to do."""


def damage_sentence(damage: tuple[str, ...]) -> str:
    """The only note on a damaged file."""
    more = f" and {len(damage) - 1} more" if len(damage) > 1 else ""
    return (
        f"the file is damaged ({damage[0]}{more}), so nothing else in it is diagnosed; restore it from a copy, or "
        "record the trial again"
    )


def require_labels(wanted: tuple[str, ...], present: tuple[str, ...]) -> None:
    """Raises UnusableTrial naming the wanted markers that the recording does not hold."""
    missing = [label for label in wanted if label not in present]
    if missing:
        raise UnusableTrial(
            f"the recording has no marker {', '.join(missing)}, only {', '.join(present) or 'none'}; "
            "correct the labels in QTM or in the cuff's section of the configuration"
        )


def require_sound_force(values: NDArray[np.float64], limit: float, unit: str = "V") -> None:
    """Raises UnusableTrial for force samples (n,), in the device's unit, that are no measurement.

    limit is the largest valid reading, inf if it is not known.
    """
    broken = np.count_nonzero(~np.isfinite(values))
    if broken:
        raise UnusableTrial(
            f"force holds {broken} of {len(values)} samples that are not finite numbers; record the trial again"
        )
    saturated = np.count_nonzero(np.abs(values) >= 0.99 * limit)
    if saturated > 3:  # a code or two at full scale is an electrical spike, not a load
        raise UnusableTrial(
            f"force is saturated in {saturated} of {len(values)} samples (at {limit:.4g} {unit}); check wiring, "
            "daq.force_range_v, load_cell.capacity_kg and the amplifier's zero"
        )
    if len(values) and np.all(values == values[0]):
        raise UnusableTrial(
            f"force reads {values[0]:g} in all {len(values)} samples, expected noise and load; check the load cell"
        )


def require_rigid_anchor(labels: tuple[str, ...], reference: NDArray[np.float64]) -> None:
    """Raises UnusableTrial unless the anchor markers (markers, 3) [m] define a frame: three seen, not in a line."""
    seen = np.isfinite(reference).all(axis=1)
    if np.count_nonzero(seen) < MIN_ANCHOR_MARKERS:
        raise UnusableTrial(
            f"the anchor has {np.count_nonzero(seen)} visible marker(s) of {', '.join(labels)}, expected at least "
            f"{MIN_ANCHOR_MARKERS} that are not in a line; put more markers on the anchoring body"
        )
    width = np.linalg.svd(reference[seen] - reference[seen].mean(axis=0), compute_uv=False)[1]
    if width < MIN_ANCHOR_WIDTH:
        raise UnusableTrial(
            f"the anchor markers {', '.join(labels)} lie in a line (spread across it {1e3 * width:.1f} mm, expected at "
            f"least {1e3 * MIN_ANCHOR_WIDTH:g} mm), so rotation about that line is not defined; move one aside"
        )


def loss_notes(
    force_gaps: tuple[tuple[float, float], ...], frame_gaps: tuple[tuple[float, float], ...]
) -> tuple[str, ...]:
    """A note for each stream that lost samples: gaps are (start, end) [s]."""
    notes = []
    for what, gaps in (("force samples were", force_gaps), ("marker frames were", frame_gaps)):
        if gaps:
            lost = [end - start for start, end in gaps]
            times = "once" if len(gaps) == 1 else f"{len(gaps)} times"
            notes.append(f"{what} lost {times}, {sum(lost):.2f} s in all, at most {max(lost):.2f} s at a time")
    return tuple(notes)


def zero_drift(time: NDArray[np.float64], force: NDArray[np.float64]) -> float | None:
    """Force (n,) [N] at rest at the trial's end less that at its start; None where it does not rest unloaded at both.

    Rest is a second whose halves differ by less than a fiftieth of the force's range, in its lowest quarter.
    """
    ends = [force[time < time[0] + REST], force[time > time[-1] - REST]]
    halves = [[float(np.mean(half)) for half in np.array_split(end, 2)] for end in ends if len(end) >= 2]
    low, high = float(force.min()), float(force.max())
    is_rest = [max(pair) < low + (high - low) / 4 and abs(pair[1] - pair[0]) < (high - low) / 50 for pair in halves]
    if len(is_rest) < 2 or not all(is_rest):
        return None
    return sum(halves[1]) / 2 - sum(halves[0]) / 2


def require_steady_zero(drift: float | None, limit: float) -> None:
    """Raises UnusableTrial if the zero drifted by more than a sound load cell's can, both [N]."""
    if drift is not None and abs(drift) > limit:
        raise UnusableTrial(
            f"the force at rest changed by {drift:+.2f} N from start to end, expected at most {limit:.2f} N "
            "(load_cell.zero_drift_relative_limit); look for a load that was left on or a loose mount, let the load "
            "cell and its amplifier warm up, and record the trial again"
        )


def zero_notes(drift: float | None, span: float) -> tuple[str, ...]:
    """A note where the zero drifted [N] by more than a force of this range [N] allows."""
    limit = max(ZERO_DRIFT, ZERO_DRIFT_PART * span)
    if drift is None or abs(drift) <= limit:
        return ()
    return (
        f"the force at rest changed by {drift:+.2f} N from start to end, expected at most {limit:.2f} N; look for a "
        "load that was left on, and warm the load cell and its amplifier up",
    )


@dataclass(frozen=True)
class MarkerQuality:
    """How far the markers of one trial can be believed.

    hidden       part of the frames without displacement
    ghosts       marker → frames in which it was left out or exchanged
    anchor_rms   m, of the anchor markers about the rigid fit
    anchor_follows_force  correlation of that rms with the force
    lean         m by which the body followed the force, from no load to the highest; already taken out
    loose        anchor marker that moves among the others, and by how many m rms; None if none does
    """

    hidden: float
    ghosts: Mapping[str, int]
    anchor_rms: float
    anchor_follows_force: float
    lean: float
    loose: tuple[str, float] | None = None


def marker_quality(
    displacement: NDArray[np.float64],
    residual: NDArray[np.float64],
    body: NDArray[np.float64],
    force: NDArray[np.float64],
    ghosts: Mapping[str, int],
) -> MarkerQuality:
    """From displacement (frames, 3), anchor residual (frames,), body (frames, 3) [m] and force (frames,) [N]."""
    seen = np.isfinite(residual) & np.isfinite(force)
    rms = float(np.sqrt(np.mean(residual[seen] ** 2))) if seen.any() else 0.0
    if np.count_nonzero(seen) < 3 or np.ptp(force[seen]) == 0 or np.ptp(residual[seen]) == 0:
        return MarkerQuality(_hidden(displacement), ghosts, rms, 0.0, 0.0)
    correlation = float(np.corrcoef(residual[seen], force[seen])[0, 1])
    load = force[seen] - force[seen].mean()
    follows = load @ (body[seen] - body[seen].mean(axis=0)) / float(load @ load)
    lean = float(np.linalg.norm(follows)) * float(np.ptp(force[seen]))
    return MarkerQuality(_hidden(displacement), ghosts, rms, correlation, lean)


def marker_notes(found: MarkerQuality) -> tuple[str, ...]:
    """What a reader should know of the markers. Raises UnusableTrial if they were hidden most of the time."""
    if found.hidden > OCCLUSION_LIMIT:
        raise UnusableTrial(
            f"anchor or cuff markers are hidden in {100 * found.hidden:.0f} % of the frames, expected at most "
            f"{100 * OCCLUSION_LIMIT:.0f} %; check the cameras' view and record again"
        )
    notes = []
    if found.hidden > OCCLUSION_NOTE:
        notes.append(f"anchor or cuff markers are hidden in {100 * found.hidden:.0f} % of the frames")
    if found.ghosts:
        listed = ", ".join(f"{label} in {count} frames" for label, count in found.ghosts.items())
        notes.append(f"markers that jumped away or changed places were left out: {listed}")
    if found.loose:
        label, way = found.loose
        notes.append(
            f"{label} moves by {1e3 * way:.1f} mm rms among the other anchor markers: it is loose, or skin moves under "
            "it; fix it, or leave it out of anchor_markers"
        )
    if found.anchor_follows_force > SKIN_CORRELATION:
        notes.append(
            f"the anchor markers deform with the load (rms {1e3 * found.anchor_rms:.2f} mm, correlation "
            f"{found.anchor_follows_force:.2f}): skin moves under a marker, and the stiffness may be biased"
        )
    if found.lean > LEAN_NOTE:
        notes.append(
            f"the body leaned {1e3 * found.lean:.1f} mm with the load; the anchor takes it out, but hold still or lean "
            "against something"
        )
    return tuple(notes)


def require_live_force(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> None:
    """Raises UnusableTrial if force (n,) [N] reads one value for a second while it should not.

    A held load may well read one code, unless the cuff (frames,) [m] moves on meanwhile, or the noise that the force
    has even where it is quietest cannot have stayed within one code for so long.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(force)) + 1, [len(force)]))
    runs = np.column_stack((bounds[:-1], bounds[1:]))
    way = float(np.nanpercentile(displacement, 99.5) - np.nanpercentile(displacement, 0.5))
    for first, last in runs[force_time[runs[:, 1] - 1] - force_time[runs[:, 0]] > STUCK]:
        start, end = float(force_time[first]), float(force_time[last - 1])
        here = displacement[(marker_time >= start) & (marker_time <= end)]
        here = here[np.isfinite(here)]
        moves = len(here) > 20 and np.percentile(here, 97.5) - np.percentile(here, 2.5) > MOVES_ON * way
        elsewhere = np.concatenate((force[:first], force[last:]))
        noise = _quietest_noise(elsewhere, max(5, round((last - first) / (end - start))))
        if moves or _chance_of_one_code(elsewhere, noise, last - first) < BEYOND_CHANCE:
            why = "while the cuff moves" if moves else f"although its noise is {noise:.2g} N"
            raise UnusableTrial(
                f"force reads {force[first]:.2f} N without change for {end - start:.1f} s from {start:.1f} s on {why}: "
                "the converter or its stream hung; check the amplifier and its cable, and record the trial again"
            )


def _quietest_noise(force: NDArray[np.float64], second: int) -> float:
    """Standard deviation [N] of force (n,) within seconds of so many samples, as in the quieter ones of them.

    From third differences, which a swing of 1 Hz at 20 Hz hardly reaches: white noise is √20 times as large in them.
    """
    seconds = force[: len(force) // second * second].reshape(-1, second)
    noise = np.std(np.diff(seconds, 3, axis=1), axis=1) / math.sqrt(20)
    return float(np.percentile(noise, QUIETER)) if len(seconds) else 0.0


def _chance_of_one_code(force: NDArray[np.float64], noise: float, count: int) -> float:
    """Probability that so many samples at the middle of a code all read it, under normal noise [N]."""
    step = code_width(force)
    dithering = math.sqrt(max(0.0, noise**2 - step**2 / 12))  # Sheppard: what the codes themselves add
    if dithering == 0:
        return 1.0
    return math.erf(step / 2 / dithering / math.sqrt(2)) ** count


def require_plausible_displacement(displacement: NDArray[np.float64]) -> None:
    """Raises UnusableTrial if displacement (frames,) [m] is none that a cuff can have: its unit is wrong."""
    scatter = float(np.nanstd(displacement))
    if scatter > MOST_DISPLACEMENT or scatter < LEAST_DISPLACEMENT:
        raise UnusableTrial(
            f"the cuff moves by {scatter:.3g} m rms, expected between {LEAST_DISPLACEMENT:g} and {MOST_DISPLACEMENT:g} "
            "m; check that the markers are in millimetres"
        )


def _hidden(displacement: NDArray[np.float64]) -> float:
    if not len(displacement):
        raise UnusableTrial("the recording has no marker frame after the sync edge; check that QTM was capturing")
    return float(np.mean(np.isnan(displacement[:, 0])))
