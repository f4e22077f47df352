"""When not to believe a trial, in sentences: what makes it unusable is raised, what makes it doubtful is a note."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

MIN_ANCHOR_MARKERS = 3
MIN_ANCHOR_WIDTH = 5e-3
"""Second singular value [m] of the anchor cluster below which rotation about its line is not defined."""
OCCLUSION_NOTE = 0.2
OCCLUSION_LIMIT = 0.5


class UnusableTrial(Exception):
    """The trial cannot be fitted; one sentence says who, what was expected, what was found, and what to do."""


def require_labels(wanted: tuple[str, ...], present: tuple[str, ...]) -> None:
    """Raises UnusableTrial naming the wanted markers that the recording does not hold."""
    missing = [label for label in wanted if label not in present]
    if missing:
        raise UnusableTrial(
            f"the recording has no marker {', '.join(missing)}, only {', '.join(present) or 'none'}; "
            "correct the labels in QTM or in the cuff's section of the configuration"
        )


def require_sound_force(values: NDArray[np.float64], limit: float) -> None:
    """Raises UnusableTrial for force samples (n,), in the device's unit, that are no measurement.

    limit is the converter's full scale in that unit, inf where it has none.
    """
    broken = np.count_nonzero(~np.isfinite(values))
    if broken:
        raise UnusableTrial(
            f"force holds {broken} of {len(values)} samples that are not finite numbers; record the trial again"
        )
    saturated = np.count_nonzero(np.abs(values) >= 0.99 * limit)
    if saturated > 3:  # a code or two at full scale is an electrical spike, not a load
        raise UnusableTrial(
            f"force is saturated in {saturated} of {len(values)} samples (at {limit:g} V); check wiring, "
            "daq.force_range_v and the amplifier's zero"
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


def occlusion_notes(displacement: NDArray[np.float64]) -> tuple[str, ...]:
    """Notes on the frames without displacement (NaN in (frames, 3)). Raises UnusableTrial if they are the majority."""
    if not len(displacement):
        raise UnusableTrial("the recording has no marker frame after the sync edge; check that QTM was capturing")
    hidden = float(np.mean(np.isnan(displacement[:, 0])))
    if hidden > OCCLUSION_LIMIT:
        raise UnusableTrial(
            f"anchor or cuff markers are hidden in {100 * hidden:.0f} % of the frames, expected at most "
            f"{100 * OCCLUSION_LIMIT:.0f} %; check the cameras' view and record again"
        )
    if hidden > OCCLUSION_NOTE:
        return (f"anchor or cuff markers are hidden in {100 * hidden:.0f} % of the frames",)
    return ()


def anchor_note(residual: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[str, ...]:
    """A note if the anchor cluster deforms with the load: residual rms (frames,) [m] against force (frames,) [N].

    Skin that follows the pull biases k and shows nowhere else (+12 % at 0.05 mm/N).
    """
    seen = np.isfinite(residual)
    if np.count_nonzero(seen) < 3 or np.ptp(force[seen]) == 0 or np.ptp(residual[seen]) == 0:
        return ()
    correlation = float(np.corrcoef(residual[seen], force[seen])[0, 1])
    if correlation > 0.3:
        return (
            f"the anchor markers deform with the load (correlation {correlation:.2f}): skin moves under a marker, and "
            "the stiffness may be biased",
        )
    return ()
