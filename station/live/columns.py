"""Live values as one row of numbers: columns of file, export and outlet, each with its unit."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from station.live.published import NAN, LiveSetup, LiveValues

AXES = "xyz"


@dataclass(frozen=True)
class LiveColumn:
    """name as in the file and the outlet; unit "" for a ratio; kind is the type of an XDF channel."""

    name: str
    unit: str
    kind: str


def live_columns(setup: LiveSetup) -> tuple[LiveColumn, ...]:
    """In the order of live_row(): coordinates and their rates in SI, every scenario, what was measured."""
    columns = [
        LiveColumn(f"{part}/{name}", unit, "Coordinate")
        for part, unit in (("coordinate", "rad or m"), ("speed", "per s"), ("acceleration", "per s^2"))
        for name in setup.coordinates
    ]
    for scenario in setup.scenarios:
        name = scenario.name
        columns += [
            LiveColumn(f"{name}/effort", "", "Effort"),
            LiveColumn(f"{name}/reserve_effort", "", "Effort"),
            LiveColumn(f"{name}/cord_force", "N", "Force"),
            *(LiveColumn(f"{name}/joint_force_{axis}", "N", "Force") for axis in AXES),
            *(LiveColumn(f"{name}/activation/{muscle}", "", "Activation") for muscle in setup.muscles),
        ]
    columns.append(LiveColumn("measured/cord_force", "N", "Force"))
    columns += [LiveColumn(f"measured/emg_rms/{name}", "uV", "EMG") for name in setup.emg_channels]
    return tuple(columns)


def live_row(setup: LiveSetup, values: LiveValues) -> list[float]:
    """NaN where there is no value."""
    row = [*values.coordinates, *values.speeds, *values.accelerations]
    for one in values.scenarios:
        row += [one.effort, one.reserve_effort, one.cord_force_n, *one.joint_force_n, *one.activations]
    has_emg = len(values.emg_rms_uv) == len(setup.emg_channels)
    emg: Iterable[float] = values.emg_rms_uv if has_emg else (NAN,) * len(setup.emg_channels)
    return [*row, values.cord_force_measured_n, *emg]
