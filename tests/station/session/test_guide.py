"""Instructions in tests of a cuff and in a pose or motion of the wearer, and findings of the latter."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from pytest import approx

from documents.message import Message
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from station.body_config import BodySection
from station.config import ProtocolSection, parse_config
from station.journal import read_journal, write_recorded
from station.messages.bench_messages import AlarmCode, CueCode
from station.messages.session_messages import ReasonCode
from station.protocol import TrialSpec
from station.session.fitted_judgement import judge_recording, largest_emg
from station.session.guide import (
    Cue,
    FreeStaticGuide,
    Guide,
    RestState,
    StaticGuide,
    SwingGuide,
    guide_for,
    wearer_guide,
)
from station.session.judgement import Judgement
from station.session.reviewer import adopt_recordings
from station.session.trial_runner import ForceLimits, force_limits
from tests.station.wearer import CYCLES, SPECS, WearerSession

Judge = Callable[..., Judgement]
RNG = np.random.default_rng(7)
MASSES = (1.5, 1.5, 1.5)
WEIGHT_N = 1.5 * 9.80665
BODY = BodySection(markers=("a", "b", "c", "d"), arm=("a", "b"), trunk=("c", "d"), pose_s=5.0, cycles=3)
WITHOUT_ARM = BodySection(markers=("a", "b", "c"), cycles=4)
PERIOD_S, HIGHEST_DEG = 4.0, 110.0
POSE, UNSUITED, TIGHT = SPECS


def cues_of(
    guide: Guide, until_s: float, force: Callable[[float], float], noise_n: float = 0.05, *, is_recorded: bool = True
) -> list[Cue]:
    """The cue after every 0.1 s of a force with some noise, 40 points a second."""
    cues = []
    for block in np.arange(0.0, until_s, 0.1):
        times = block + np.arange(4) * 0.025
        points = [(float(t), force(float(t)) + float(RNG.normal(0, noise_n))) for t in times]
        guide.update(points, is_recorded=is_recorded)
        cues.append(guide.cue())
    return cues


def instructions(cues: list[Cue]) -> list[tuple[CueCode, float | str | None, int | None]]:
    """Code, weight and target [N] of every new instruction."""
    found = []
    for cue in cues:
        figures, target = cue.message.figures, cue.message.figures.get("target_n")
        found.append((cue.message.code, figures.get("weight"), None if target is None else round(float(target))))
    return list(dict.fromkeys(found))


def steps_of(heights: list[float], hold_s: float) -> Callable[[float], float]:
    """Each level for hold_s, the hand-over lasting the last 0.5 s of it; the empty hook pulls 2 N."""
    times, values = [], []
    for number, height in enumerate(heights):
        times += [number * hold_s, (number + 1) * hold_s - 0.5]
        values += [height, height]
    return lambda t: 2.0 + float(np.interp(t, times, values))


def test_a_static_trial_is_guided_step_by_step() -> None:
    guide = StaticGuide(MASSES, 4.0)
    up = [0.0, WEIGHT_N, 2 * WEIGHT_N, 3 * WEIGHT_N]
    cues = cues_of(guide, 8.0 * 7, steps_of([*up, *up[-2::-1]], 8.0))
    assert instructions(cues) == [
        (CueCode.EMPTY_HOOK, None, None),
        (CueCode.ADD_WEIGHT, 1, 17),
        (CueCode.ADD_WEIGHT, 2, 31),
        (CueCode.ADD_WEIGHT, 3, 46),
        (CueCode.REMOVE_WEIGHT, 3, 31),
        (CueCode.REMOVE_WEIGHT, 2, 17),
        (CueCode.REMOVE_WEIGHT, 1, 2),
        (CueCode.STATIC_DONE, None, None),
    ]
    assert cues[-1].is_done
    assert not any(cue.is_done for cue in cues[: len(cues) // 2])


def test_the_hold_counts_down_only_while_the_force_rests_and_an_operator_who_is_ahead_is_followed() -> None:
    guide = StaticGuide(MASSES, 8.0)
    cues = cues_of(guide, 20.0, steps_of([0.0, WEIGHT_N, WEIGHT_N, WEIGHT_N], 5.0))
    first_level = [cue for cue in cues if cue.step == 1]
    assert {cue.left_s for cue in first_level if cue.rest is not RestState.STEADY} == {7.0}
    assert min(cue.left_s for cue in first_level if cue.left_s is not None) < 1.0
    guide = StaticGuide(MASSES, 30.0)
    cues = cues_of(guide, 20.0, steps_of([0.0, WEIGHT_N, 2 * WEIGHT_N, 2 * WEIGHT_N], 5.0))
    assert instructions(cues)[-1] == (CueCode.ADD_WEIGHT, 2, 31)


@pytest.mark.parametrize("noise_n", [0.3, 0.6, 1.0])
def test_amplifier_noise_does_not_delay_a_hold(noise_n: float) -> None:
    """The noise of a USB-6008 with a load cell of 50 kg is about 0.6 N."""
    guide = StaticGuide(MASSES, 7.0)
    steps = steps_of([0.0, WEIGHT_N, WEIGHT_N], 6.0)
    cues = cues_of(guide, 16.0, lambda t: steps(t) + float(RNG.normal(0, noise_n)))
    held = next(number for number, cue in enumerate(cues) if cue.step == 2)
    assert 0.1 * held < 6.0 + 7.0 + 1.0, "seven seconds from the hand-over, and not begun again"


def test_the_empty_hook_is_measured_again_after_arming_and_a_weight_hung_before_is_none() -> None:
    guide = StaticGuide(MASSES, 3.0)
    guide.update([(t, 2.0) for t in np.arange(-3.0, 0.0, 0.025).tolist()], is_recorded=False)
    assert guide.cue().message == Message(CueCode.EMPTY_HOOK)
    cues = cues_of(guide, 10.0, steps_of([WEIGHT_N, 2 * WEIGHT_N], 5.0))
    assert instructions(cues)[-2:] == [(CueCode.ADD_WEIGHT, 2, 31), (CueCode.ADD_WEIGHT, 3, 46)]
    guide = StaticGuide(MASSES, 4.0)
    guide.update([(t, 0.0) for t in np.arange(-3.0, 0.0, 0.025).tolist()], is_recorded=False)
    cues = cues_of(guide, 5.0, lambda _: 9.0)
    assert instructions(cues)[-1] == (CueCode.ADD_WEIGHT, 1, 24)


def test_a_moving_body_is_distinguished_from_a_settling_force() -> None:
    swaying = cues_of(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0 + 3.0 * np.sin(2 * np.pi * 2.0 * t))
    settling = cues_of(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0 + 4.0 * t)
    resting = cues_of(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0)
    rests = [cues[-1].rest for cues in (swaying, settling, resting)]
    assert rests == [RestState.MOVING, RestState.SETTLING, RestState.STEADY]
    assert resting[0].rest is RestState.WAITING


def test_a_wrong_weight_is_reported_with_the_expected_force() -> None:
    guide = StaticGuide(MASSES, 4.0)
    cues = cues_of(guide, 16.0, steps_of([0.0, 0.6 * WEIGHT_N], 8.0))
    assert cues[-1].message.code is CueCode.WRONG_FORCE
    assert cues[-1].message.figures == {"force_n": approx(10.8, abs=0.05), "target_n": approx(16.7, abs=0.05)}
    assert cues[-1].step == 1


def test_weights_of_unknown_mass_are_counted_level_by_level() -> None:
    cues = cues_of(FreeStaticGuide(4.0), 24.0, steps_of([0.0, WEIGHT_N, 0.0], 8.0))
    held = [cue.message.figures["force_n"] for cue in cues if cue.message.code is CueCode.HOLD]
    assert approx(17.0, abs=0.5) in held
    assert cues[0].message.code is CueCode.FIRST_LEVEL
    assert cues[-1].message == Message(CueCode.NEXT_LEVEL, {"levels": 3, "hold_s": 4.0})


def test_a_swing_is_counted_and_brought_to_rest() -> None:
    cues = cues_of(SwingGuide(15.0), 34.0, lambda t: 25.0 + 12.0 * (4.0 < t < 26.0) * np.sin(2 * np.pi * 0.9 * t))
    assert cues[10].message.code is CueCode.STAND_STILL
    swinging = cues[150]
    assert swinging.message.figures["frequency_hz"] == approx(0.9, abs=0.05) and swinging.rest is RestState.SWINGING
    assert swinging.left_s is not None and 2.0 < swinging.left_s < 9.0
    assert cues[220].message.code is CueCode.LET_REST
    assert cues[-1].is_done


def test_a_swing_that_begins_from_a_noisy_level_is_counted_at_its_own_pace() -> None:
    def force(t: float) -> float:
        if t < 5.0:
            return 4.0
        swing = 12.0 * np.sin(2 * np.pi * (t - 6.5)) if t > 6.5 else 0.0
        return 22.0 + swing + float(RNG.normal(0, 1.0))

    messages = [cue.message for cue in cues_of(SwingGuide(15.0), 14.0, force)]
    counted = [float(found.figures["frequency_hz"]) for found in messages if found.code is CueCode.KEEP_SWINGING]
    assert len(counted) > 50
    assert max(counted) < 1.2 and counted[-1] == approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("limits", "points", "alarm"),
    [
        ((150.0, 500.0), [(0.0, 151.0)], AlarmCode.FORCE),
        ((150.0, 500.0), [(0.0, 0.0), (0.1, 80.0)], AlarmCode.FORCE_RATE),
        ((150.0, 500.0), [(0.0, 0.0), (0.1, 40.0), (0.2, 80.0)], None),
        *(((600.0, 5e3, 490.0), [(0.0, force)], AlarmCode.OVERLOAD) for force in (500.0, -500.0)),
    ],
)
def test_a_force_beyond_a_limit_or_the_load_cell_s_capacity_in_either_direction_raises_an_alarm(
    limits: tuple[float, ...], points: list[tuple[float, float]], alarm: AlarmCode | None
) -> None:
    raised = ForceLimits(*limits).check(points)
    assert (raised and raised.code) is alarm and (raised is None or str(raised).startswith("STOP: "))
    if raised is not None and alarm is AlarmCode.OVERLOAD:
        assert raised.figures == {"force_n": points[0][1], "capacity_n": 490.0}


def test_the_force_ceiling_follows_a_small_load_cell() -> None:
    small, usual = (parse_config({"load_cell": {"capacity_kg": kg}}, "this test") for kg in (10, 50))
    assert force_limits(small).force_n == approx(0.8 * 10 * 9.80665)
    assert (force_limits(usual).force_n, force_limits(usual).capacity_n) == (150.0, approx(50 * 9.80665))


def test_the_stages_of_a_trial_are_named_and_a_bounce_has_no_wearer_to_stand_still() -> None:
    assert StaticGuide((1.0, 1.0), 7.0).stages == ("empty", "+1", "+2", "\u22122", "\u22121")
    assert SwingGuide(20.0).stages == ("stand still", "swing", "rest")
    bounce = guide_for("bounce", ProtocolSection())
    assert bounce.stages == ("hang still", "bounce", "rest")
    cues = cues_of(bounce, 5.0, lambda _: 25.0)
    assert [cues[at].message.code for at in (10, -1)] == [CueCode.HANG_STILL, CueCode.BOUNCE]


def raising(time: float) -> float:
    """Elevation [deg] of an arm that is raised and lowered three times, every PERIOD_S."""
    return float(10.0 + (HIGHEST_DEG - 10.0) * np.sin(np.pi * min(time, 3 * PERIOD_S) / PERIOD_S) ** 2)


def cues_at(
    guide: Guide, elevation: Callable[[float], float], until_s: float, *, is_recorded: bool = True
) -> list[Cue]:
    return cues_of(guide, until_s, elevation, 0.0, is_recorded=is_recorded)


def test_a_pose_is_held_for_its_duration_of_recording_and_an_arm_that_moves_is_shown_as_moving() -> None:
    guide = wearer_guide(None, BODY, is_pose=True)
    armed = cues_at(guide, lambda _: 12.0, 2.0, is_recorded=False)
    assert {cue.left_s for cue in armed} == {None}
    cues = cues_at(guide, lambda _: 12.0, 6.0)
    assert [cue.message.code for cue in (cues[10], cues[-1])] == [CueCode.HOLD_POSE, CueCode.POSE_DONE]
    assert cues[10].left_s == pytest.approx(5.0 - 1.075)
    assert cues[10].rest is RestState.STEADY and cues[-1].is_done
    cues = cues_at(wearer_guide(None, BODY, is_pose=True), lambda t: 12.0 + 5.0 * np.sin(6.0 * t), 3.0)
    assert cues[-1].rest is RestState.MOVING


def test_every_cycle_of_the_arm_is_a_step_of_a_motion() -> None:
    cues = cues_at(wearer_guide("tight", BODY, is_pose=False), raising, 3 * PERIOD_S + 1.0)
    steps = [cue.step for cue in cues]
    assert steps == sorted(steps) and set(steps) == {0, 1, 2, 3}
    codes = [cue.message.code for cue in cues]
    changes = [code for code, before in zip(codes, [None, *codes], strict=False) if code != before]
    assert changes == [*[CueCode.RAISE_ARM, CueCode.LOWER_ARM] * 3, CueCode.MOTION_DONE]
    assert cues[-1].is_done and "cycle 1 of 3" in cues[0].sentence


@pytest.mark.parametrize("period_s", [3.0, 12.0])
def test_an_instruction_lasts_until_the_arm_has_followed_it(period_s: float) -> None:
    """Whoever turns back at "lower the arm" must have raised it fully."""
    cues = cues_at(wearer_guide("tight", BODY, is_pose=False), lambda t: raising(t * PERIOD_S / period_s), 3 * period_s)
    codes = [cue.message.code for cue in cues]
    for number, (before, code) in enumerate(pairwise(codes), start=1):
        elevation = raising((0.1 * number + 0.075) * PERIOD_S / period_s)
        if (before, code) == (CueCode.RAISE_ARM, CueCode.LOWER_ARM):
            assert elevation > 0.9 * HIGHEST_DEG
        if (before, code) == (CueCode.LOWER_ARM, CueCode.RAISE_ARM):
            assert elevation < 0.25 * HIGHEST_DEG
    assert codes.count(CueCode.LOWER_ARM) == pytest.approx(codes.count(CueCode.RAISE_ARM), rel=0.2)


def test_cycles_before_the_recording_do_not_count() -> None:
    guide = wearer_guide("unsuited", BODY, is_pose=False)
    assert cues_at(guide, raising, 2 * PERIOD_S, is_recorded=False)[-1].step == 0


@pytest.mark.parametrize(
    ("guide", "code"),
    [
        (wearer_guide("mvc", BODY, is_pose=False), CueCode.CONTRACT),
        (wearer_guide("slack", WITHOUT_ARM, is_pose=False), CueCode.MOVE_UNCOUNTED),
    ],
)
def test_a_motion_without_counted_cycles_has_one_instruction(guide: Guide, code: CueCode) -> None:
    cue = guide.cue()
    assert (cue.message.code, cue.rest, cue.step, cue.is_done) == (code, RestState.NO_ELEVATION, 0, False)
    assert cues_at(guide, raising, 1.0)[-1].message.code is code


@pytest.fixture(scope="module")
def folder(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wearer's session with a journal, as the console finds it."""
    folder = tmp_path_factory.mktemp("judged")
    for path in wearer.folder.glob("*.mcap"):
        shutil.copy(path, folder)
    adopt_recordings(folder)
    return folder


@pytest.fixture
def judged(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Judge:
    """The judgement of a trial that was changed after it was read."""

    def judge(spec: TrialSpec, change: Callable[[WearerTrial], WearerTrial] = lambda trial: trial) -> Judgement:
        monkeypatch.setattr(
            "station.session.fitted_judgement.read_wearer_trial", lambda path: change(read_wearer_trial(path))
        )
        return judge_recording(folder, spec.file_name(1))

    return judge


def quantities(judgement: Judgement) -> dict[str, str]:
    return {row.quantity: row.this for row in judgement.rows}


def test_a_motion_is_drawn_with_its_elevation_its_emg_and_the_force_of_the_cord_alone(judged: Judge) -> None:
    axes = "elevation [°]", "EMG [µV]", "cord [N]"
    shown = [[axis in judged(spec).drawing for axis in axes] for spec in (POSE, UNSUITED, TIGHT)]
    assert shown == [[False, False, False], [True, True, False], [True, True, True]]
    assert judged(UNSUITED).drawing.count('quiet dotted"') == CYCLES


def test_a_pose_is_accepted_with_its_largest_movement(judged: Judge, wearer: WearerSession) -> None:
    judgement = judged(POSE)
    assert (judgement.title, judgement.advice, judgement.reasons, judgement.grade) == ("pose", "accept", (), "good")
    trial = read_wearer_trial(wearer.path(POSE))
    truth = wearer.person.markers(wearer.starts[trial.file] + trial.time)
    of_body = [wearer.person.labels.index(label) for label in trial.body.body]
    ranges = np.ptp(truth[:, of_body], axis=0).max(axis=1)
    moved, marker = quantities(judgement)["largest movement [mm]"].split(" ")
    assert marker == f"({trial.body.body[int(np.argmax(ranges))]})"
    assert float(moved) == pytest.approx(ranges.max(), abs=1.5)


def test_a_motion_is_accepted_with_its_cycles_force_and_emg(judged: Judge) -> None:
    judgement = judged(TIGHT)
    assert (judgement.title, judgement.reasons) == ("motion, suit, cord tight", ())
    shown = quantities(judgement)
    assert shown["cycles"] == f"{CYCLES} of {CYCLES}"
    low, high = map(float, shown["cord force, zero not removed [N]"].split(" to "))
    assert high - low > 20
    assert float(shown["EMG deltoid RMS [\u00b5V]"]) > 30
    assert "cord force, zero not removed [N]" not in quantities(judged(UNSUITED))


def test_the_largest_emg_is_the_largest_spread_of_50_ms(wearer: WearerSession, tmp_path: Path) -> None:
    path = wearer.path(TIGHT)
    signals = read_wearer_trial(path).emg
    assert signals is not None
    of_deltoid = 1e6 * signals.values[:, signals.labels.index("deltoid")]
    expected = max(np.std(block) for block in np.array_split(of_deltoid, len(of_deltoid) // 50))
    found = largest_emg(path)
    assert found.keys() == {"deltoid", "trapezius"} and found["deltoid"] == pytest.approx(expected, rel=0.1)
    assert largest_emg(tmp_path / "none.mcap") == {}


def test_a_motion_with_fewer_cycles_than_planned_is_to_be_redone(judged: Judge) -> None:
    def one_cycle_less(trial: WearerTrial) -> WearerTrial:
        return replace(trial, cycles=trial.cycles[1:])

    (reason,) = judged(UNSUITED, one_cycle_less).reasons
    assert (reason.code, reason.figures) == (ReasonCode.CYCLES_MISSING, {"found": CYCLES - 1, "planned": CYCLES})
    contraction = judged(
        UNSUITED, lambda trial: replace(one_cycle_less(trial), manifest=replace(trial.manifest, condition="mvc"))
    )
    assert contraction.reasons == (), "a maximal contraction has no cycles"


def test_a_pose_with_a_marker_hidden_too_often_or_a_wearer_who_moves_is_to_be_redone(judged: Judge) -> None:
    def hide(trial: WearerTrial) -> WearerTrial:
        markers = trial.markers.copy()
        markers[: len(markers) // 5, trial.labels.index("EpM")] = np.nan
        return replace(trial, markers=markers)

    def step_aside(trial: WearerTrial) -> WearerTrial:
        markers = trial.markers.copy()
        markers[len(markers) // 2 :, :, 0] += 0.2
        return replace(trial, markers=markers)

    (hidden,), (moved,) = judged(POSE, hide).reasons, judged(POSE, step_aside).reasons
    assert (hidden.code, hidden.figures["markers"]) == (ReasonCode.MARKERS_HIDDEN, "EpM")
    assert moved.code is ReasonCode.POSE_MOVES and moved.figures["range_mm"] == approx(200, abs=40)


def test_emg_without_signal_or_clock_is_to_be_redone(judged: Judge) -> None:
    def unplug(trial: WearerTrial) -> WearerTrial:
        assert trial.emg is not None
        values = trial.emg.values.copy()
        values[:, 1] = 0.0
        return replace(trial, emg=replace(trial.emg, values=values))

    (reason,) = judged(UNSUITED, unplug).reasons
    found = reason.code, reason.figures["channel"], reason.figures["finding"]
    assert found == (ReasonCode.EMG_UNUSABLE, "trapezius", "flat")
    (reason,) = judged(UNSUITED, lambda trial: replace(trial, emg=None)).reasons
    assert reason.code is ReasonCode.NO_EMG_CLOCK


def test_a_trial_that_the_recorder_did_not_accept_is_to_be_redone(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "session")
    entry = next(entry for entry in read_journal(folder).recorded if entry.test == "pose")
    lossy = replace(entry, file="lossy.mcap", lost_samples=3)
    shutil.copy(folder / entry.file, tmp_path / "session" / lossy.file)
    write_recorded(tmp_path / "session", lossy)
    judgement = judge_recording(tmp_path / "session", lossy.file)
    assert [reason.code for reason in judgement.reasons] == [ReasonCode.LOST_SAMPLES]
    (tmp_path / "session" / lossy.file).write_bytes(b"no recording")
    judgement = judge_recording(tmp_path / "session", lossy.file)
    assert [reason.code for reason in judgement.reasons] == [ReasonCode.LOST_SAMPLES, ReasonCode.UNUSABLE]
