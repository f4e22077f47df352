"""Which devices a configuration asks for."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from drivers.capture_note import CaptureNote
from drivers.catalogue import make_device
from drivers.device import Device
from recordings.manifest import BounceRig, CuffSite
from station.clock import Clock
from station.config import StationConfig

CAPTURE_NOTE = ".capture"
"""In the session's folder while QTM captures for it."""


def devices_for(
    config: StationConfig, subject: CuffSite | BounceRig | None, clock: Clock, folder: Path
) -> list[Device]:
    """The devices of one trial, not yet opened; the markers of its subject must be among the labels.

    The session's folder tells them what a recorder that was killed has left running.
    """
    daq, cell, mocap = config.daq, config.load_cell, config.mocap
    wanted = subject.labels if subject else ()
    times: dict[str, Any] = {"host_clock": clock.utc_ns, "seconds": clock.station_s}
    devices = [
        make_device(
            "nidaq",
            device=daq.device,
            grpc_target=daq.grpc_target,
            force_channel=daq.force_channel if cell.source == "daq" else None,
            sync_channel=daq.sync_channel,
            force_range_v=daq.force_range_v,
            sync_range_v=daq.sync_range_v,
            sample_rate_hz=daq.sample_rate_hz,
            start=daq.start,
            **times,
            timeout_scale=clock.timeout_scale,
        ),
        make_device(
            "qualisys",
            host=mocap.host,
            port=mocap.port,
            control=None if mocap.control == "none" else mocap.control,
            password=mocap.password,
            wanted_labels=wanted,
            capture_note=CaptureNote(folder / CAPTURE_NOTE, clock.utc_ns),
            **times,
            timeout_scale=clock.timeout_scale,
        ),
    ]
    if cell.source == "serial":
        devices.append(
            make_device(
                "serial_load_cell",
                port=cell.port,
                baud_rate=cell.baud_rate,
                line_format=cell.line_format,
                **times,
            )
        )
    return devices
