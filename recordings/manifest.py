"""Who, when, which cuff, with what: everything a fit needs beside the samples, written before the first of them."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal

TestKind = Literal["static", "dynamic"]


@dataclass(frozen=True)
class CuffSite:
    """The cuff under test and its markers, by label.

    site is "arm" or "waist"; rope_markers is empty where the rope carries none.
    """

    name: str
    site: Literal["arm", "waist"]
    anchor_markers: tuple[str, ...]
    cuff_markers: tuple[str, ...]
    rope_markers: tuple[str, ...] = ()


@dataclass(frozen=True)
class LoadCell:
    """How /force becomes newtons: newtons = polarity × value × newtons_per_unit.

    For an amplifier newtons_per_unit is capacity_kg × 9.80665 / full_scale_v, for an indicator that of its unit.
    """

    source: Literal["daq", "serial"]
    newtons_per_unit: float
    polarity: Literal[1, -1]
    serial_number: str = ""


@dataclass(frozen=True)
class Manifest:
    """One trial's passport.

    start_utc_ns is the host's UTC at arming; start is "sync_edge" or "pfi0" (then force sample 0 is the edge).
    effective_config is the whole configuration that was in force, as plain data; versions maps package to version.
    """

    cuff: CuffSite
    test: TestKind
    repeat: int
    run: int
    donning: str
    start: Literal["sync_edge", "pfi0"]
    sync_threshold_v: float
    load_cell: LoadCell
    start_utc_ns: int
    effective_config: dict[str, Any] = field(default_factory=dict)
    versions: dict[str, str] = field(default_factory=dict)
