"""The manifest of a trial, from the configuration and the place of the trial in the plan."""

from __future__ import annotations

from typing import Literal

from recordings.manifest import BodyMarkers, BounceRig, CuffSite, LoadCell, Manifest, TrialSubject
from station.config import StationConfig
from station.protocol import TrialSpec
from station.versions import installed_versions


def make_manifest(
    config: StationConfig,
    spec: TrialSpec,
    run: int,
    subject: TrialSubject,
    start_utc_ns: int,
    *,
    start: Literal["sync_edge", "pfi0", "declared", "one_clock"],
    load_cell: LoadCell,
) -> Manifest:
    """The manifest without devices, and with session time 0 at 0 of the device clocks."""
    is_wearer = isinstance(subject, BodyMarkers)
    return Manifest(
        cuff=subject if isinstance(subject, CuffSite) else None,
        bounce=subject if isinstance(subject, BounceRig) else None,
        body=subject if isinstance(subject, BodyMarkers) else None,
        condition=spec.condition,
        emg=config.emg.amplifier() if config.emg and is_wearer else None,
        test=spec.test,
        repeat=spec.repeat,
        run=run,
        donning=spec.donning,
        start=start,
        sync_threshold_v=config.sync.threshold_v,
        load_cell=load_cell,
        start_utc_ns=start_utc_ns,
        timing=config.timing(),
        protocol=config.measurement_protocol(),
        effective_config=config.model_dump(mode="json"),
        versions=installed_versions(),
    )
