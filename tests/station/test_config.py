from __future__ import annotations

from pathlib import Path

import pytest

from recordings.manifest import BounceRig
from station.config import ConfigError, load_config, parse_config

HAND = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}


def test_an_empty_configuration_is_the_published_bench() -> None:
    config = parse_config({}, "test")
    assert (config.daq.force_channel, config.daq.sync_channel, config.daq.sample_rate_hz) == ("ai0", "ai1", 1000)
    assert config.calibration().newtons_per_unit == pytest.approx(50 * 9.80665 / 5)


def test_the_published_cuffs_know_their_site() -> None:
    config = parse_config({"cuffs": {"hand": HAND, "waist": HAND}}, "test")
    assert (config.cuff_site("hand").site, config.cuff_site("waist").site) == ("arm", "waist")


def test_what_a_trial_is_of_is_a_cuff_or_the_bouncing_weight() -> None:
    config = parse_config({"cuffs": {"hand": HAND}, "bounce": {"mass_kg": 2.5, "marker": "weight"}}, "test")
    assert config.subject("hand") == config.cuff_site("hand")
    assert config.subject(None) == BounceRig(2.5, "weight")
    assert config.subject(None).labels == ("weight",)
    assert config.subject("hand").labels == ("a", "b", "c", "d")
    with pytest.raises(ConfigError, match=r"no \[bounce\], expected the weight's mass_kg"):
        parse_config({}, "test").subject(None)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"daq": {"sample_rate": 1000}}, "unknown key daq.sample_rate; did you mean sample_rate_hz?"),
        ({"dqa": {}}, "unknown key dqa; did you mean daq?"),
        ({"zzz": 1}, "unknown key zzz; the example station.toml names every key"),
        ({"daq": {"sample_rate_hz": 6000}}, "at most 5000"),
        ({"bounce": {"marker": "weight"}}, "bounce.mass_kg is missing"),
        ({"bounce": {"mass_kg": -1, "marker": "weight"}}, "bounce.mass_kg is -1"),
        ({"protocol": {"step_masses_kg": [1.5, 0]}}, "protocol.step_masses_kg.1 is 0"),
        ({"sync": {"lag_sd_s": -0.1}}, "sync.lag_sd_s is -0.1"),
        ({"sync": {"stop_edge": "frame"}}, "sync.stop_edge is 'frame'"),
        ({"sync": {"stop_edge": "end_of_exposure"}}, "no exposure_s is given"),
        ({"daq": {"sample_rate_hz": "fast"}}, "daq.sample_rate_hz is 'fast'"),
        ({"daq": {"start": "now"}}, "daq.start is 'now'"),
        ({"load_cell": {"source": "serial"}}, "no port is given"),
        ({"load_cell": {"polarity": 0}}, "load_cell.polarity is 0"),
        ({"cuffs": {"new": HAND}}, "cuffs.new.site is missing"),
        ({"cuffs": {"hand": {**HAND, "anchor_markers": ["shoulder", "elbow"]}}}, "2 marker(s), expected at least 3"),
        ({"cuffs": {"hand": {"anchor_markers": ["a", "b", "c"], "cuff_markers": []}}}, "cuffs.hand.cuff_markers"),
    ],
)
def test_a_wrong_configuration_is_named_in_one_sentence(data: dict[str, object], words: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_config(data, "station.toml")
    assert words in str(caught.value)
    assert str(caught.value).startswith("station.toml: ")
    assert "\n" not in str(caught.value)


def test_one_channel_may_use_the_whole_device() -> None:
    serial = {"source": "serial", "port": "COM3"}
    assert parse_config({"daq": {"sample_rate_hz": 10_000}, "load_cell": serial}, "t").daq.sample_rate_hz == 10_000


def test_an_unknown_cuff_is_refused_with_what_to_add() -> None:
    with pytest.raises(ConfigError, match=r"only hand; add \[cuffs\.knee\]"):
        parse_config({"cuffs": {"hand": HAND}}, "t").cuff_site("knee")


def test_a_missing_or_broken_file_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot read"):
        load_config(tmp_path / "none.toml")
    broken = tmp_path / "broken.toml"
    broken.write_text("[daq\n")
    with pytest.raises(ConfigError, match="not valid TOML"):
        load_config(broken)
    broken.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="not UTF-8"):
        load_config(broken)


def test_the_example_configuration_loads() -> None:
    config = load_config(Path(__file__).parents[2] / "station.toml")
    assert sorted(config.cuffs) == ["elbow", "hand", "tube", "waist"]
