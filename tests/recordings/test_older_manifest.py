"""A recording of an older station, whose settings stand in its effective_config alone, opens with them typed."""

from __future__ import annotations

import json
from typing import Any

import pytest

from recordings.errors import RecordingCode
from recordings.manifest import Manifest, MeasurementProtocol, Timing, manifest_from_json, manifest_to_json
from tests.recordings.refusals import raises_refusal
from tests.recordings.trials import MANIFEST

ADDED = {
    "": ("timing", "protocol"),
    "load_cell": ("range_v", "zero_drift_relative_limit"),
    "cuff": ("mass_kg",),
}
CONFIG: dict[str, Any] = {
    "daq": {"force_range_v": 5.0},
    "load_cell": {"gain_relative_sd": 0.004, "zero_drift_relative_limit": 0.05},
    "sync": {"lag_s": 0.012, "lag_sd_s": 0.002, "stop_edge": "end_of_exposure", "exposure_s": 0.003},
    "cuffs": {"hand": {"mass_kg": 0.35}, "elbow": {"mass_kg": 0.1}},
    "protocol": {"step_masses_kg": [1.5, 1.5], "hold_s": 6.0, "swing_s": 15.0},
}


def _older(config: Any, **load_cell: Any) -> dict[str, Any]:
    """The manifest as it was written before the settings were typed."""
    plain = json.loads(manifest_to_json(MANIFEST)) | {"effective_config": config}
    for section, keys in ADDED.items():
        for key in keys:
            del (plain[section] if section else plain)[key]
    plain["load_cell"] |= load_cell
    return plain


def _opened(plain: dict[str, Any]) -> Manifest:
    return manifest_from_json(json.dumps(plain))


def test_every_setting_of_the_fit_is_read_from_the_configuration_that_was_in_force() -> None:
    manifest = _opened(_older(CONFIG))
    cell = manifest.load_cell
    assert (cell.range_v, cell.gain_relative_sd, cell.zero_drift_relative_limit) == (5.0, 0.004, 0.05)
    assert manifest.timing == Timing(0.012, 0.002, "end_of_exposure", 0.003)
    assert manifest.protocol == MeasurementProtocol((1.5, 1.5), 6.0, 15.0)
    assert manifest.cuff is not None
    assert manifest.cuff.mass_kg == 0.35


def test_a_typed_setting_of_an_older_manifest_counts() -> None:
    assert _opened(_older({}, gain_relative_sd=0.01)).load_cell.gain_relative_sd == 0.01
    assert _opened(_older(CONFIG, gain_relative_sd=0.01)).load_cell.gain_relative_sd == 0.01


@pytest.mark.parametrize("config", [{}, {"sync": None, "cuffs": [1]}, {"sync": {"stop_edge": None}}])
def test_what_no_configuration_held_is_the_default(config: dict[str, Any]) -> None:
    manifest = _opened(_older(config))
    assert (manifest.timing, manifest.protocol) == (Timing(), MeasurementProtocol())
    assert manifest.cuff is not None
    assert manifest.cuff.mass_kg is None


def test_a_manifest_with_typed_settings_takes_nothing_from_the_configuration() -> None:
    plain = json.loads(manifest_to_json(MANIFEST)) | {"effective_config": CONFIG}
    manifest = _opened(plain)
    assert (manifest.timing, manifest.protocol, manifest.load_cell) == (
        MANIFEST.timing,
        MANIFEST.protocol,
        MANIFEST.load_cell,
    )


@pytest.mark.parametrize(
    ("config", "place"),
    [
        ({"sync": {"lag_s": "soon"}}, "timing.lag_s"),
        ({"sync": {"stop_edge": "end_of_exposure"}}, "timing: stop_edge"),
        ({"cuffs": {"hand": {"mass_kg": "light"}}}, "cuff.mass_kg"),
    ],
)
def test_a_setting_that_is_no_figure_is_named(config: dict[str, Any], place: str) -> None:
    with raises_refusal(RecordingCode.MANIFEST, naming=f"cannot be read: {place}"):
        _opened(_older(config))
