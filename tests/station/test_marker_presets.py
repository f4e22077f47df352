from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from station.config import ConfigError, parse_config, preset_labels
from station.messages.setup_codes import ConfigCode
from tests.station.refusals import raises_refusal

TABLE = Path(__file__).parents[2] / "station" / "marker_presets.toml"
BODIES = ["left_arm", "right_arm", "left_forearm", "right_forearm", "torso", "pelvis"]


def test_every_body_is_made_of_markers_that_qualisys_lists() -> None:
    preset = tomllib.loads(TABLE.read_text(encoding="utf-8"))["qualisys_sports"]
    assert preset["source"].startswith("https://github.com/qualisys/")
    assert len(preset["markers"]) == len(set(preset["markers"])) == 41
    assert sorted(set(preset) - {"source", "markers"}) == sorted(BODIES)
    for body in BODIES:
        assert set(preset[body]) <= set(preset["markers"]) and len(preset[body]) >= 3


def test_left_and_right_mirror_each_other() -> None:
    for body in ("arm", "forearm"):
        left, right = (preset_labels(f"qualisys_sports.{side}_{body}") for side in ("left", "right"))
        assert [label[1:] for label in left] == [label[1:] for label in right]


def test_a_preset_gives_the_labels_of_the_anchor_and_of_the_recording() -> None:
    cuff = {"anchor_preset": "qualisys_sports.left_arm", "label_prefix": "Q_", "cuff_markers": ["strap"]}
    config = parse_config({"cuffs": {"hand": cuff}}, "test")
    expected = ("Q_LShoulderTop", "Q_LArm", "Q_LElbowOut", "Q_LElbowIn")
    assert config.cuff_site("hand").anchor_markers == expected
    assert parse_config(config.model_dump(), "the effective configuration") == config


@pytest.mark.parametrize(
    ("cuff", "code", "reason"),
    [
        (
            {"anchor_preset": "sports"},
            ConfigCode.WRONG_VALUE,
            "'sports' is not a preset, expected one of qualisys_sports.left_arm, ",
        ),
        ({"anchor_preset": "qualisys_sports.markers"}, ConfigCode.WRONG_VALUE, "is not a preset"),
        (
            {"anchor_preset": "qualisys_sports.torso", "anchor_markers": ["a", "b", "c"]},
            ConfigCode.WRONG_VALUE,
            "are both given",
        ),
        (
            {"label_prefix": "Q_", "anchor_markers": ["a", "b", "c"]},
            ConfigCode.UNKNOWN_KEY,
            "unknown key cuffs.hand.label_prefix",
        ),
    ],
)
def test_an_unknown_preset_is_refused(cuff: dict[str, object], code: ConfigCode, reason: str) -> None:
    with raises_refusal(ConfigError, code) as caught:
        parse_config({"cuffs": {"hand": {**cuff, "cuff_markers": ["strap"]}}}, "test")
    assert reason in str(caught.value)
