"""The devices of a configuration."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from drivers.device import Device
from drivers.nidaq import AnalogInput
from drivers.qualisys_settings import BLOCK_S, CaptureNote
from drivers.reconnecting import make_device
from recordings.manifest import BodyMarkers, TrialSubject
from station.body_config import EmgSection
from station.clock import Clock
from station.config import StationConfig

CAPTURE_NOTE = ".capture"
"""File in the session's folder while QTM captures for it."""
LIVE_BLOCK_S = 0.002
"""Wall seconds over which frames are gathered where they are solved live: a frame must not wait for others."""


def devices_for(config: StationConfig, subject: TrialSubject | None, clock: Clock, folder: Path) -> list[Device]:
    """The devices of one trial, not yet opened; the markers of its subject must be among the labels.

    EMG and further analog inputs are included for a trial of the wearer, and without a subject. A note in the
    session's folder shows the drivers whether a killed recorder left a capture running.
    """
    is_of_wearer = subject is None or isinstance(subject, BodyMarkers)
    devices = [
        _daq(config, clock, _wearer_inputs(config) if is_of_wearer else ()),
        _mocap(config, subject, clock, folder),
    ]
    if config.load_cell.source == "serial":
        devices.append(_indicator(config, clock))
    if is_of_wearer and config.emg is not None and config.emg.source == "lsl":
        devices.append(_emg_outlet(config.emg, clock))
    return devices


def load_cell_for(config: StationConfig, _subject: TrialSubject | None, clock: Clock, _folder: Path) -> list[Device]:
    """Only the device that reads the load cell: a known mass needs no mocap system."""
    return [_indicator(config, clock) if config.load_cell.source == "serial" else _daq(config, clock)]


def _wearer_inputs(config: StationConfig) -> list[AnalogInput]:
    emg = config.emg
    channels = emg.daq_channels.items() if emg else ()
    return [
        *(AnalogInput("/emg", name, channel.input, emg.range_v) for name, channel in channels if emg),
        *(AnalogInput("/analog", name, section.input, section.range_v) for name, section in config.analog.items()),
    ]


def _daq(config: StationConfig, clock: Clock, wearer_inputs: Sequence[AnalogInput] = ()) -> Device:
    daq = config.daq
    force = AnalogInput("/force", "force", daq.force_channel, daq.force_range_v)
    sync = AnalogInput("/sync", "sync", daq.sync_channel, daq.sync_range_v)
    bench = (force, sync) if config.load_cell.source == "daq" else (sync,)
    return make_device(
        "nidaq",
        device=daq.device,
        grpc_target=daq.grpc_target,
        inputs=(*bench, *wearer_inputs),
        sample_rate_hz=daq.sample_rate_hz,
        start=daq.start,
        timeout_scale=clock.timeout_scale,
        **_times(clock),
    )


def _mocap(config: StationConfig, subject: TrialSubject | None, clock: Clock, folder: Path) -> Device:
    mocap = config.mocap
    is_live = config.live.enabled and isinstance(subject, BodyMarkers)
    return make_device(
        "qualisys",
        host=mocap.host,
        port=mocap.port,
        control=None if mocap.control == "none" else mocap.control,
        password=mocap.password,
        wanted_labels=subject.labels if subject else (),
        capture_note=CaptureNote(folder / CAPTURE_NOTE, clock.utc_ns),
        block_s=LIVE_BLOCK_S if is_live else BLOCK_S,
        timeout_scale=clock.timeout_scale,
        **_times(clock),
    )


def _indicator(config: StationConfig, clock: Clock) -> Device:
    cell = config.load_cell
    return make_device(
        "serial_load_cell", port=cell.port, baud_rate=cell.baud_rate, line_format=cell.line_format, **_times(clock)
    )


def _emg_outlet(emg: EmgSection, clock: Clock) -> Device:
    return make_device(
        "lsl",
        stream=emg.stream,
        channels={name: channel.input for name, channel in emg.channels.items()},
        sync_channel=emg.sync_channel,
        unit=emg.unit,
        timeout_scale=clock.timeout_scale,
        **_times(clock),
    )


def _times(clock: Clock) -> dict[str, Any]:
    return {"host_clock": clock.utc_ns, "seconds": clock.station_s}
