"""Uncertainty of a trial's common time: offset and ratio of the two clocks, and the resulting error in N and m."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting import quality
from fitting.timing.clock_fit import SyncErrors
from fitting.timing.decimation import highest_rate, motion_of
from fitting.timing.timeline import MILLIMETRE, tie_by_edge
from recordings.manifest import Manifest
from recordings.reader import Track


@dataclass(frozen=True)
class SyncCertificate:
    """Uncertainty of the time that the recorded sync line gives. Standard uncertainties unless stated otherwise.

    offset, offset_sd  [s] of the DAQ's clock when the capture began
    drift, drift_sd    the DAQ's seconds in a mocap second, less 1; assumed where there is one edge only
    drift_ci95         its 95 % interval; None where there is one edge only
    is_identified      whether the edges alone determine the drift
    has_both_edges     whether the stop edge was used
    contradiction      [s] by which the stop edge contradicts the number of frames; the trial's lag is that uncertain
    force_rate, speed  [N/s], [m/s] the trial's highest
    errors             of the time at its worst moment, and of force and displacement at these rates
    findings           irregularities of the line, in sentences
    """

    offset: float
    offset_sd: float
    drift: float
    drift_sd: float
    drift_ci95: tuple[float, float] | None
    is_identified: bool
    has_both_edges: bool
    contradiction: float
    force_rate: float
    speed: float
    errors: SyncErrors
    findings: tuple[str, ...] = ()

    @property
    def sentence(self) -> str:
        edges = "start and stop edge" if self.has_both_edges else "start edge alone"
        return (
            f"{edges}: offset {self.offset:.4f} s ± {1e3 * self.offset_sd:.2f} ms, {self._ratio}; time good to "
            f"{1e3 * self.errors.time:.2f} ms: {self.errors.force:.2f} N at {self.force_rate:.0f} N/s, or "
            f"{1e3 * self.errors.displacement:.3f} mm at {1e3 * self.speed:.0f} mm/s"
        )

    @property
    def _ratio(self) -> str:
        if self.drift_ci95 is None:
            return f"clock ratio not identified, assumed {1e6 * self.drift:+.0f} ± {1e6 * self.drift_sd:.0f} ppm"
        low, high = (f"{1e6 * end:+.0f}" for end in self.drift_ci95)
        if not self.is_identified:
            return f"clock ratio not identified, between {low} and {high} ppm"
        return f"clock ratio {1e6 * self.drift:+.0f} ppm (95 % CI {low} to {high} ppm)"


def certify(manifest: Manifest, decimated: Mapping[str, Track]) -> SyncCertificate | None:
    """Sync certificate from decimated tracks (decimation.py); None without a sync line. Raises UnusableTrial."""
    if not manifest.begins_at_edge:
        return None
    motion = motion_of(manifest)
    if "/markers" in decimated:
        quality.require_labels((*motion.anchor, *motion.pulled), decimated["/markers"].stream.labels)
    both = tie_by_edge(manifest, decimated)
    force, frames = decimated["/force"], both.frames
    frame_time = both.first_frame + frames.seconds - frames.seconds[0]
    duration = float(min(both.force_time[-1], frame_time[-1]))
    worst = max(both.clock.errors(duration, 0.0, 0.0).time, both.edge_sd)  # which knows of frames that contradict
    inside, seen = (both.force_time >= 0) & (both.force_time <= duration), frame_time <= duration
    numbers = force.sample_numbers[inside].astype(np.int64)
    volts_rate = highest_rate(numbers, force.values[inside], force.stream.rate_hz)
    force_rate = manifest.load_cell.newtons_per_unit * volts_rate
    speed = MILLIMETRE * highest_rate(frames.numbers[seen], frames.values[seen], frames.stream.rate_hz)
    return SyncCertificate(
        offset=both.clock.start,
        offset_sd=both.clock.time_sd(0.0),
        drift=both.clock.ratio - 1,
        drift_sd=math.sqrt(float(both.clock.covariance[1, 1])),
        drift_ci95=both.clock.drift_ci95,
        is_identified=both.clock.is_identified,
        has_both_edges=both.clock.has_both_edges,
        contradiction=both.stop_contradiction,
        force_rate=force_rate,
        speed=speed,
        errors=SyncErrors(worst, worst * force_rate, worst * speed),
        findings=both.sync_findings,
    )
