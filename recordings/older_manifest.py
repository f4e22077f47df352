"""Manifests of older stations, in which the fit's settings stood in effective_config alone.

This is the one place where a setting is read from there. A manifest with `timing` is not an older one and is kept.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

SETTINGS = (
    ("load_cell", "gain_relative_sd", ("load_cell", "gain_relative_sd")),
    ("load_cell", "zero_drift_relative_limit", ("load_cell", "zero_drift_relative_limit")),
    ("load_cell", "range_v", ("daq", "force_range_v")),
    ("timing", "lag_s", ("sync", "lag_s")),
    ("timing", "lag_sd_s", ("sync", "lag_sd_s")),
    ("timing", "stop_edge", ("sync", "stop_edge")),
    ("timing", "exposure_s", ("sync", "exposure_s")),
    ("protocol", "step_masses_kg", ("protocol", "step_masses_kg")),
    ("protocol", "hold_s", ("protocol", "hold_s")),
    ("protocol", "swing_s", ("protocol", "swing_s")),
)
"""Section and key of the typed manifest, and the path of the same setting in effective_config."""


def with_typed_fields(manifest: Any) -> Any:
    """An older manifest (plain data) with every setting that only its effective_config holds in its typed field."""
    if not isinstance(manifest, dict) or "timing" in manifest:
        return manifest
    config, grown = manifest.get("effective_config"), dict(manifest)
    for section, key, path in SETTINGS:
        _fill(grown, section, key, _entry(config, path))
    cuff = grown.get("cuff")
    if isinstance(cuff, dict) and isinstance(cuff.get("name"), str):
        _fill(grown, "cuff", "mass_kg", cuff_mass(config, cuff["name"]))
    return grown


def cuff_mass(effective_config: Any, cuff: str) -> Any:
    """mass_kg of a cuff in the configuration that was in force; None where it is not there."""
    return _entry(effective_config, ("cuffs", cuff, "mass_kg"))


def _fill(manifest: dict[str, Any], section: str, key: str, value: Any) -> None:
    typed = manifest.get(section, {})
    if value is not None and isinstance(typed, dict) and not typed.get(key):  # an import left gain_relative_sd at 0
        manifest[section] = {**typed, key: value}


def _entry(data: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        data = data.get(key) if isinstance(data, Mapping) else None
    return data
