"""Uncertainty of the common time of a trial: offset and ratio of the clocks, and the resulting errors in N and m."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from fitting.results.codes import TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.clock_fit import SyncErrors
from fitting.trial.decimation import highest_rate, motion_of
from fitting.trial.force_quality import require_labels
from fitting.trial.timeline import MILLIMETRE, align_by_sync_edge
from recordings.manifest import Manifest
from recordings.reader import Track


@dataclass(frozen=True)
class SyncCertificate:
    """Uncertainty of the time from the recorded sync line. Standard uncertainties unless stated otherwise.

    offset, offset_sd  [s] of the DAQ's clock when the capture began
    drift, drift_sd    DAQ seconds per mocap second, minus 1; assumed if there is only one edge
    drift_ci95         its 95 % interval; None with only one edge
    is_identified      whether the edges alone determine the drift
    has_both_edges     whether the stop edge was used
    contradiction      [s] by which the stop edge contradicts the number of frames; included in the lag's uncertainty
    force_rate, speed  [N/s], [m/s] highest rates of the trial
    errors             largest error of the time, and errors of force and displacement at these rates
    findings           irregularities of the line
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
    findings: tuple[Note, ...] = ()

    @property
    def summary(self) -> Note:
        """Offset, clock ratio and their uncertainty; its text is one line."""
        figures = {
            "offset_of_both_edges_s" if self.has_both_edges else "offset_of_start_edge_s": self.offset,
            "offset_sd_s": self.offset_sd,
            "time_sd_s": self.errors.time,
            "force_sd_n": self.errors.force,
            "force_rate_n_per_s": self.force_rate,
            "displacement_sd_m": self.errors.displacement,
            "speed_m_per_s": self.speed,
        }
        if self.drift_ci95 is None:
            figures |= {"assumed_drift": self.drift, "drift_sd": self.drift_sd}
        elif self.is_identified:
            figures |= {"drift": self.drift, "low": self.drift_ci95[0], "high": self.drift_ci95[1]}
        else:
            figures |= {"lowest_drift": self.drift_ci95[0], "highest_drift": self.drift_ci95[1]}
        return Note(TrialNoteCode.SYNC_CERTIFICATE, figures)

    def to_plain(self) -> dict[str, object]:
        """As JSON."""
        return {
            "has_both_edges": self.has_both_edges,
            "offset_s": self.offset,
            "offset_standard_error_s": self.offset_sd,
            "clock_ratio_ppm": 1e6 * self.drift,
            "clock_ratio_standard_error_ppm": 1e6 * self.drift_sd,
            "clock_ratio_ci95_ppm": None if self.drift_ci95 is None else [1e6 * end for end in self.drift_ci95],
            "clock_ratio_is_identified": self.is_identified,
            "stop_edge_contradiction_s": self.contradiction,
            "peak_force_rate_n_per_s": self.force_rate,
            "peak_speed_m_per_s": self.speed,
            "time_standard_error_s": self.errors.time,
            "force_standard_error_n": self.errors.force,
            "displacement_standard_error_m": self.errors.displacement,
            "findings": list(map(str, self.findings)),
            "finding_codes": [note.to_plain() for note in self.findings],
        }


def certify(manifest: Manifest, decimated: Mapping[str, Track]) -> SyncCertificate | None:
    """Sync certificate from decimated tracks (decimation.py); None without a sync line. Raises UnusableTrial."""
    if not manifest.begins_at_edge:
        return None
    motion = motion_of(manifest)
    if "/markers" in decimated:
        require_labels((*motion.anchor, *motion.pulled), decimated["/markers"].stream.labels)
    aligned = align_by_sync_edge(manifest, decimated)
    force, frames = decimated["/force"], aligned.frames
    frame_time = aligned.first_frame + frames.seconds - frames.seconds[0]
    duration = float(min(aligned.force_time[-1], frame_time[-1]))
    worst = max(aligned.clock.errors(duration, 0.0, 0.0).time, aligned.edge_sd)  # edge_sd includes a contradiction
    inside, seen = (aligned.force_time >= 0) & (aligned.force_time <= duration), frame_time <= duration
    numbers = force.sample_numbers[inside].astype(np.int64)
    volts_rate = highest_rate(numbers, force.values[inside], force.stream.rate_hz)
    force_rate = manifest.load_cell.newtons_per_unit * volts_rate
    speed = MILLIMETRE * highest_rate(frames.numbers[seen], frames.values[seen], frames.stream.rate_hz)
    return SyncCertificate(
        offset=aligned.clock.start,
        offset_sd=aligned.clock.time_sd(0.0),
        drift=aligned.clock.ratio - 1,
        drift_sd=math.sqrt(float(aligned.clock.covariance[1, 1])),
        drift_ci95=aligned.clock.drift_ci95,
        is_identified=aligned.clock.is_identified,
        has_both_edges=aligned.clock.has_both_edges,
        contradiction=aligned.stop_contradiction,
        force_rate=force_rate,
        speed=speed,
        errors=SyncErrors(worst, worst * force_rate, worst * speed),
        findings=aligned.sync_findings,
    )
