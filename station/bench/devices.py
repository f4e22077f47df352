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
    devices = [_daq(config, clock), _mocap(config, subject, clock, folder)]
    return [*devices, _indicator(config, clock)] if config.load_cell.source == "serial" else devices


def load_cell_for(
    config: StationConfig, _subject: CuffSite | BounceRig | None, clock: Clock, _folder: Path
) -> list[Device]:
    """The device that reads the load cell, alone: weighing needs no mocap system, and gives nobody cause to capture."""
    return [_indicator(config, clock) if config.load_cell.source == "serial" else _daq(config, clock)]


def _daq(config: StationConfig, clock: Clock) -> Device:
    daq = config.daq
    return make_device(
        "nidaq",
        device=daq.device,
        grpc_target=daq.grpc_target,
        force_channel=daq.force_channel if config.load_cell.source == "daq" else None,
        sync_channel=daq.sync_channel,
        force_range_v=daq.force_range_v,
        sync_range_v=daq.sync_range_v,
        sample_rate_hz=daq.sample_rate_hz,
        start=daq.start,
        timeout_scale=clock.timeout_scale,
        **_times(clock),
    )


def _mocap(config: StationConfig, subject: CuffSite | BounceRig | None, clock: Clock, folder: Path) -> Device:
    mocap = config.mocap
    return make_device(
        "qualisys",
        host=mocap.host,
        port=mocap.port,
        control=None if mocap.control == "none" else mocap.control,
        password=mocap.password,
        wanted_labels=subject.labels if subject else (),
        capture_note=CaptureNote(folder / CAPTURE_NOTE, clock.utc_ns),
        timeout_scale=clock.timeout_scale,
        **_times(clock),
    )


def _indicator(config: StationConfig, clock: Clock) -> Device:
    cell = config.load_cell
    return make_device(
        "serial_load_cell",
        port=cell.port,
        baud_rate=cell.baud_rate,
        line_format=cell.line_format,
        **_times(clock),
    )


def _times(clock: Clock) -> dict[str, Any]:
    return {"host_clock": clock.utc_ns, "seconds": clock.station_s}
