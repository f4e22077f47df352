import re
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest

from drivers.simulators.shoulder import published_shoulder
from recordings.manifest import BodyMarkers, BounceRig, EmgAmplifier, TestKind, TrialCondition
from station.config import ConfigError, load_config, parse_config, preset_labels
from station.messages.setup_messages import ConfigCode
from station.protocol import TrialSpec, published_plan
from tests.refusals import raises_refusal

HAND = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
BODIES = ["left_arm", "right_arm", "left_forearm", "right_forearm", "torso", "pelvis"]


def test_an_empty_configuration_is_the_published_bench() -> None:
    config = parse_config({}, "t")
    assert (config.daq.force_channel, config.daq.sync_channel, config.daq.sample_rate_hz) == ("ai0", "ai1", 1000)
    assert config.calibration().newtons_per_unit == pytest.approx(50 * 9.80665 / 5)


def test_the_subject_of_a_trial_is_a_cuff_or_the_bouncing_weight() -> None:
    config = parse_config({"cuffs": {"hand": HAND}, "bounce": {"mass_kg": 2.5, "marker": "weight"}}, "test")
    hand, bounce = TrialSpec("hand", "static", 1), TrialSpec(None, "bounce", 1)
    assert config.subject(hand) == config.cuff_site("hand")
    assert config.subject(bounce) == BounceRig(2.5, "weight")
    assert config.subject(bounce).labels == ("weight",)
    assert config.subject(hand).labels == ("a", "b", "c", "d")
    with raises_refusal(ConfigCode.NO_BOUNCE, kind=ConfigError):
        parse_config({}, "test").subject(bounce)


def test_the_subject_of_a_wearer_s_trial_is_the_body_and_the_worn_suit() -> None:
    body = {"markers": ["c7", "t8", "ac", "el"], "suit_markers": ["w"], "arm": ["ac", "el"], "trunk": ["c7", "t8"]}
    config = parse_config({"body": {**body, "is_cord_measured": True, "cycles": 7}}, "test")
    pose, free, tight = (
        config.subject(TrialSpec(None, test, 1, condition=condition))  # type: ignore[arg-type]
        for test, condition in (("pose", None), ("motion", "unsuited"), ("motion", "tight"))
    )
    assert pose == free
    assert pose.labels == ("c7", "t8", "ac", "el")
    assert tight.labels == (*pose.labels, "w")
    assert isinstance(tight, BodyMarkers) and isinstance(free, BodyMarkers)
    assert (tight.is_cord_measured, free.is_cord_measured) == (True, False)
    assert (config.measurement_protocol().pose_s, config.measurement_protocol().cycles) == (5.0, 7)
    with raises_refusal(ConfigCode.NO_BODY, kind=ConfigError):
        parse_config({}, "test").subject(TrialSpec(None, "pose", 1))


def test_emg_is_recorded_with_the_gains_of_its_amplifier() -> None:
    config = parse_config({"emg": {"channels": {"deltoid": {"input": "ai2", "gain": 500}}, "lag_s": 0.01}}, "test")
    assert config.emg.amplifier() == EmgAmplifier("daq", {"deltoid": 500.0}, None, 0.01, 0.0005)
    assert config.daq_inputs == ["ai0", "ai1", "ai2"]
    outlet = {"source": "lsl", "stream": "amp", "sync_channel": "t", "channels": {"deltoid": {"input": "Ch 1"}}}
    config = parse_config({"emg": outlet}, "test")
    assert config.emg.amplifier() == EmgAmplifier("lsl", {"deltoid": 1.0}, 0.5)
    assert config.daq_inputs == ["ai0", "ai1"]


@pytest.mark.parametrize(
    ("data", "words"),
    [
        ({"daq": {"sample_rate_hz": 6000}}, "at most 5000"),
        ({"load_cell": {"calibrated_on": "last spring"}}, "load_cell.calibrated_on is"),
        ({"bounce": {"marker": "weight"}}, "bounce.mass_kg is missing"),
        ({"bounce": {"mass_kg": -1, "marker": "weight"}}, "bounce.mass_kg is -1"),
        ({"protocol": {"step_masses_kg": [1.5, 0]}}, "protocol.step_masses_kg.1 is 0"),
        ({"sync": {"lag_sd_s": -0.1}}, "sync.lag_sd_s is -0.1"),
        ({"sync": {"lag_s": float("nan")}}, "sync.lag_s is nan"),
        ({"load_cell": {"capacity_kg": float("inf")}}, "load_cell.capacity_kg is inf"),
        ({"sync": {"stop_edge": "frame"}}, "sync.stop_edge is 'frame'"),
        ({"sync": {"stop_edge": "end_of_exposure"}}, "no exposure_s is given"),
        ({"daq": {"sample_rate_hz": "fast"}}, "daq.sample_rate_hz is 'fast'"),
        ({"daq": {"start": "now"}}, "daq.start is 'now'"),
        ({"load_cell": {"source": "serial"}}, "no port is given"),
        ({"load_cell": {"polarity": 0}}, "load_cell.polarity is 0"),
        ({"cuffs": {"new": HAND}}, "cuffs.new.site is missing"),
        ({"body": {"markers": ["a", "b"]}}, "body.markers"),
        ({"body": {"markers": ["a", "b", "b"]}}, "b is named twice"),
        ({"body": {"markers": ["a", "b", "c"], "arm": ["a", "d"], "trunk": ["b", "c"]}}, "d is in arm or trunk"),
        ({"body": {"markers": ["a", "b", "c"], "arm": ["a", "b"]}}, "arm and trunk need two labels each"),
        ({"body": {"markers": ["a", "b", "c"], "conditions": ["loose"]}}, "body.conditions.0 is 'loose'"),
        ({"emg": {"channels": {}}}, 'source is "daq" and no channel is given'),
        ({"emg": {"source": "lsl"}}, 'source is "lsl" and no stream is given'),
        ({"emg": {"channels": {"a": {"input": "ai2"}}, "stream": "amp"}}, "are for source"),
        ({"emg": {"channels": {"a": {"input": "ai1"}}}}, "the DAQ input ai1 is given to two signals"),
        ({"analog": {"a": {"input": "ai2"}}, "daq": {"sample_rate_hz": 4000}}, "at most 3333"),
        ({"cuffs": {"hand": {**HAND, "anchor_markers": ["shoulder", "elbow"]}}}, "2 marker(s), expected at least 3"),
        ({"cuffs": {"hand": {"anchor_markers": ["a", "b", "c"], "cuff_markers": []}}}, "cuffs.hand.cuff_markers"),
        (
            {"cuffs": {"hand": {"anchor_preset": "sports"}}},
            "'sports' is not a preset, expected one of qualisys_sports.l",
        ),
        ({"cuffs": {"hand": {"anchor_preset": "qualisys_sports.markers"}}}, "is not a preset"),
        ({"cuffs": {"hand": {"anchor_preset": "qualisys_sports.torso", **HAND}}}, "are both given"),
    ],
)
def test_a_wrong_value_is_refused_with_the_reason(data: dict[str, object], words: str) -> None:
    with raises_refusal(ConfigCode.WRONG_VALUE, words, kind=ConfigError) as caught:
        parse_config(data, "station.toml")
    assert str(caught.value).startswith("station.toml: ")


@pytest.mark.parametrize(
    ("data", "key", "advice"),
    [
        ({"daq": {"sample_rate": 1000}}, "daq.sample_rate", "sample_rate_hz"),
        ({"dqa": {}}, "dqa", "daq"),
        ({"cuffs": {"hand": {"label_prefix": "Q_", **HAND}}}, "cuffs.hand.label_prefix", "station.toml"),
        ({"bounce": {"mass_kg": 2.5, "marker": "w", "spring_mas_kg": 0}}, "bounce.spring_mas_kg", "spring_mass_kg"),
        ({"zzz": 1}, "zzz", "station.toml"),
    ],
)
def test_an_unknown_key_is_refused_with_the_nearest_one(data: dict[str, object], key: str, advice: str) -> None:
    with raises_refusal(ConfigCode.UNKNOWN_KEY, kind=ConfigError) as caught:
        parse_config(data, "station.toml")
    figures = caught.value.cause.figures
    assert key in figures["reason"] and advice in figures["advice"]


def test_one_channel_may_use_the_whole_device() -> None:
    serial = {"source": "serial", "port": "COM3"}
    assert parse_config({"daq": {"sample_rate_hz": 10_000}, "load_cell": serial}, "t").daq.sample_rate_hz == 10_000


def test_the_published_cuffs_have_a_site_and_an_unknown_one_is_refused() -> None:
    config = parse_config({"cuffs": {"hand": HAND, "waist": HAND}}, "test")
    assert (config.cuff_site("hand").site, config.cuff_site("waist").site) == ("arm", "waist")
    with raises_refusal(ConfigCode.UNKNOWN_CUFF, kind=ConfigError):
        config.cuff_site("knee")


def test_a_missing_or_broken_file_is_refused(tmp_path: Path) -> None:
    with raises_refusal(ConfigCode.MISSING, kind=ConfigError):
        load_config(tmp_path / "none.toml")
    for content in (b"[daq\n", b"\xff\xfe\x00"):
        (tmp_path / "broken.toml").write_bytes(content)
        with raises_refusal(ConfigCode.WRONG_SYNTAX, kind=ConfigError):
            load_config(tmp_path / "broken.toml")


def test_the_example_has_four_cuffs_and_its_sections_for_the_wearer_load_once_they_are_uncommented() -> None:
    path = Path(__file__).parents[2] / "station.toml"
    assert sorted(load_config(path).cuffs) == ["elbow", "hand", "tube", "waist"]
    example = path.read_text(encoding="utf-8")
    section = example[example.index("# [body]") : example.index("# [analog")]
    of_outlets = r"^# (?:stream|unit|sync_\w+) = .*\n"
    plain = re.sub(r"^# ", "", re.sub(of_outlets, "", section, flags=re.MULTILINE), flags=re.MULTILINE)
    config = parse_config(tomllib.loads(plain), "example")
    assert config.body is not None and config.emg is not None
    person = published_shoulder()
    assert {*config.body.markers, *config.body.suit_markers} == {*person.markers, *person.cord}
    assert list(config.emg.channels) == ["anterior_deltoid", "upper_trapezius"]


def test_every_body_is_made_of_markers_that_qualisys_lists() -> None:
    table = Path(__file__).parents[2] / "station" / "marker_presets.toml"
    preset = tomllib.loads(table.read_text(encoding="utf-8"))["qualisys_sports"]
    assert preset["source"].startswith("https://github.com/qualisys/")
    assert len(preset["markers"]) == len(set(preset["markers"])) == 41
    assert sorted(set(preset) - {"source", "markers"}) == sorted(BODIES)
    for body in BODIES:
        assert set(preset[body]) <= set(preset["markers"]) and len(preset[body]) >= 3
    for body in ("arm", "forearm"):
        left, right = (preset_labels(f"qualisys_sports.{side}_{body}") for side in ("left", "right"))
        assert [label[1:] for label in left] == [label[1:] for label in right]


def test_a_preset_gives_the_labels_of_the_anchor_and_of_the_recording() -> None:
    cuff = {"anchor_preset": "qualisys_sports.left_arm", "label_prefix": "Q_", "cuff_markers": ["strap"]}
    config = parse_config({"cuffs": {"hand": cuff}}, "test")
    expected = ("Q_LShoulderTop", "Q_LArm", "Q_LElbowOut", "Q_LElbowIn")
    assert config.cuff_site("hand").anchor_markers == expected
    assert parse_config(config.model_dump(), "the effective configuration") == config


def test_the_published_plan_has_24_trials_for_four_cuffs() -> None:
    plan = list(published_plan(["waist", "hand", "tube", "elbow"], repeats=3))
    assert len(plan) == 24
    first = [("waist", "static", 1), ("waist", "dynamic", 1), ("waist", "static", 2), ("waist", "dynamic", 2)]
    assert [(trial.cuff, trial.test, trial.repeat) for trial in plan[:4]] == first


@pytest.mark.parametrize(("runs", "following"), [((), 1), ((1, 2), 3), ((10,), 1)])
def test_a_rerecording_gets_the_next_number(tmp_path: Path, runs: tuple[int, ...], following: int) -> None:
    spec = TrialSpec("hand", "static", 1)
    for run in runs:
        (tmp_path / spec.file_name(run)).touch()
    assert spec.next_free_run(tmp_path) == following


BIDS = "sub-P1_task-{test}_acq-{cuff}_run-{run}"


@pytest.mark.parametrize(
    ("test", "condition", "name", "file"),
    [
        ("bounce", None, None, "test-bounce_run-2.mcap"),
        ("pose", None, None, "test-pose_run-2.mcap"),
        ("motion", "tight", None, "condition-tight_test-motion_run-2.mcap"),
        ("motion", "slack", BIDS, "sub-P1_task-motion_acq-slack_run-2.mcap"),
        ("pose", None, BIDS, "sub-P1_task-pose_run-2.mcap"),
        ("pose", None, "{cuff}-{test}-{run}", "pose-pose-2.mcap"),
    ],
)
def test_the_condition_of_a_motion_is_in_its_file_name(
    tmp_path: Path, test: TestKind, condition: TrialCondition | None, name: str | None, file: str
) -> None:
    spec = TrialSpec(None, test, 1, condition=condition)
    spec = replace(spec, name=name) if name else spec
    assert spec.file_name(2) == file
    (tmp_path / spec.file_name(1)).touch()
    assert spec.next_free_run(tmp_path) == 2


def test_the_wearer_s_trials_are_around_the_cuffs_those_without_the_suit_first() -> None:
    plan = list(published_plan(["hand"], 1, has_bounce=True, conditions=("unsuited", "slack", "tight", "mvc")))
    assert [(trial.cuff, trial.test, trial.condition) for trial in plan] == [
        *((None, "bounce", None), (None, "pose", None), (None, "motion", "unsuited"), (None, "motion", "mvc")),
        *(("hand", "static", None), ("hand", "dynamic", None)),
        *((None, "motion", "slack"), (None, "motion", "tight")),
    ]
