from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from station.config import parse_config
from station.session.guide import Ceilings, Cue, FreeStaticGuide, Guide, Rest, StaticGuide, SwingGuide, ceilings_of

RNG = np.random.default_rng(7)
MASSES = (1.5, 1.5, 1.5)
WEIGHT_N = 1.5 * 9.80665


def told(guide: Guide, until_s: float, force: Callable[[float], float], start_s: float = 0.0) -> list[Cue]:
    """The cue after every 0.1 s of a force with some noise, 40 points a second."""
    cues = []
    for block in np.arange(start_s, until_s, 0.1):
        times = block + np.arange(4) * 0.025
        guide.take([(float(t), force(float(t)) + float(RNG.normal(0, 0.05))) for t in times])
        cues.append(guide.cue())
    return cues


def steps_of(heights: list[float], hold_s: float) -> Callable[[float], float]:
    """Each level for hold_s, the hand-over lasting the last 0.5 s of it; the empty hook pulls 2 N."""
    times, values = [], []
    for number, height in enumerate(heights):
        times += [number * hold_s, (number + 1) * hold_s - 0.5]
        values += [height, height]
    return lambda t: 2.0 + float(np.interp(t, times, values))


def test_a_whole_static_trial_is_led_step_by_step_to_its_end() -> None:
    guide = StaticGuide(MASSES, 4.0)
    up = [0.0, WEIGHT_N, 2 * WEIGHT_N, 3 * WEIGHT_N]
    cues = told(guide, 8.0 * 7, steps_of([*up, *up[-2::-1]], 8.0))
    orders = list(dict.fromkeys(cue.sentence for cue in cues))
    assert orders == [
        "leave the hook empty and stand still",
        "add weight 1 of 3: 17 N, hold 4 s",
        "add weight 2 of 3: 31 N, hold 4 s",
        "add weight 3 of 3: 46 N, hold 4 s",
        "take weight 3 off: 31 N, hold 4 s",
        "take weight 2 off: 17 N, hold 4 s",
        "take weight 1 off: 2 N, hold 4 s",
        "all weights are off and held: end the capture",
    ]
    assert cues[-1].is_done
    assert not any(cue.is_done for cue in cues[: len(cues) // 2])


def test_the_hold_counts_down_only_while_the_force_rests_at_its_level() -> None:
    guide = StaticGuide(MASSES, 8.0)
    cues = told(guide, 20.0, steps_of([0.0, WEIGHT_N, WEIGHT_N, WEIGHT_N], 5.0))
    first_level = [cue for cue in cues if cue.step == 1]
    assert {cue.left_s for cue in first_level if cue.rest is not Rest.STEADY} == {7.0}
    assert min(cue.left_s for cue in first_level if cue.left_s is not None) < 1.0


@pytest.mark.parametrize("noise_n", [0.3, 0.6, 1.0])
def test_the_noise_of_an_amplifier_holds_up_no_hold(noise_n: float) -> None:
    """The noise of a USB-6008 with a load cell of 50 kg is about 0.6 N."""
    guide = StaticGuide(MASSES, 7.0)
    steps = steps_of([0.0, WEIGHT_N, WEIGHT_N], 6.0)
    cues = told(guide, 16.0, lambda t: steps(t) + float(RNG.normal(0, noise_n)))
    held = next(number for number, cue in enumerate(cues) if cue.step == 2)
    assert 0.1 * held < 6.0 + 7.0 + 1.0, "seven seconds from the hand-over, and not begun again"


def test_a_hand_that_is_quicker_than_the_guide_is_followed() -> None:
    guide = StaticGuide(MASSES, 30.0)
    cues = told(guide, 20.0, steps_of([0.0, WEIGHT_N, 2 * WEIGHT_N, 2 * WEIGHT_N], 5.0))
    assert cues[-1].sentence == "add weight 2 of 3: 31 N, hold 30 s"


def test_a_weight_that_hangs_before_the_guide_sees_the_recording_is_not_taken_for_the_empty_hook() -> None:
    guide = StaticGuide(MASSES, 3.0)
    guide.take([(t, 2.0) for t in np.arange(-3.0, 0.0, 0.025).tolist()], is_recorded=False)
    assert guide.cue().sentence == "leave the hook empty and stand still"
    cues = told(guide, 10.0, steps_of([WEIGHT_N, 2 * WEIGHT_N], 5.0))
    orders = list(dict.fromkeys(cue.sentence for cue in cues))
    assert orders[-2:] == ["add weight 2 of 3: 31 N, hold 3 s", "add weight 3 of 3: 46 N, hold 3 s"]


def test_a_hook_that_is_hung_up_after_arming_is_weighed_anew() -> None:
    guide = StaticGuide(MASSES, 4.0)
    guide.take([(t, 0.0) for t in np.arange(-3.0, 0.0, 0.025).tolist()], is_recorded=False)
    cues = told(guide, 5.0, lambda _: 9.0)
    assert cues[-1].sentence == "add weight 1 of 3: 24 N, hold 4 s"


def test_a_body_that_moves_is_told_from_a_force_that_settles() -> None:
    swaying = told(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0 + 3.0 * np.sin(2 * np.pi * 2.0 * t))
    settling = told(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0 + 4.0 * t)
    resting = told(StaticGuide(MASSES, 4.0), 3.0, lambda t: 20.0)
    assert [cues[-1].rest for cues in (swaying, settling, resting)] == [Rest.MOVING, Rest.SETTLING, Rest.STEADY]
    assert resting[0].rest is Rest.WAITING


def test_a_wrong_weight_is_named_with_what_was_expected() -> None:
    guide = StaticGuide(MASSES, 4.0)
    cues = told(guide, 16.0, steps_of([0.0, 0.6 * WEIGHT_N], 8.0))
    assert cues[-1].sentence == "10.8 N instead of 16.7 N: the right weight? Does the rope run free?"
    assert cues[-1].step == 1


def test_weights_of_unknown_mass_are_counted_level_by_level() -> None:
    cues = told(FreeStaticGuide(4.0), 24.0, steps_of([0.0, WEIGHT_N, 0.0], 8.0))
    orders = list(dict.fromkeys(cue.sentence for cue in cues))
    assert "hold it at 17 N" in orders
    assert cues[-1].sentence == "3 levels held: add a weight or take one off, and hold it for 4 s"


def test_a_swing_is_counted_and_brought_to_rest() -> None:
    def force(t: float) -> float:
        return 25.0 + (12.0 * np.sin(2 * np.pi * 0.9 * t) if 4.0 < t < 26.0 else 0.0)

    cues = told(SwingGuide("pull the spring", 15.0), 34.0, force)
    assert cues[10].sentence == "stand still"
    swinging = cues[150]
    assert swinging.sentence.startswith("keep it swinging: 0.9") and swinging.rest is Rest.SWINGING
    assert swinging.left_s is not None and 2.0 < swinging.left_s < 9.0
    assert cues[220].sentence == "let it come to rest"
    assert cues[-1].is_done


def test_a_swing_that_begins_from_a_noisy_level_is_counted_at_its_own_pace() -> None:
    def force(t: float) -> float:
        if t < 5.0:
            return 4.0
        swing = 12.0 * np.sin(2 * np.pi * (t - 6.5)) if t > 6.5 else 0.0
        return 22.0 + swing + float(RNG.normal(0, 1.0))

    said = [cue.sentence for cue in told(SwingGuide("pull the spring", 15.0), 14.0, force)]
    counted = [float(words.split()[3]) for words in said if words.startswith("keep it swinging")]
    assert len(counted) > 50
    assert max(counted) < 1.2 and counted[-1] == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize(
    ("points", "word"),
    [([(0.0, 151.0)], "151 N at the cuff"), ([(0.0, 0.0), (0.1, 80.0)], "rose by more than 500 N a second")],
)
def test_a_ceiling_is_an_unmistakable_stop(points: list[tuple[float, float]], word: str) -> None:
    said = Ceilings(150.0, 500.0).broken_by(points)
    assert said is not None and said.startswith("STOP: ") and word in said


def test_beyond_the_load_cell_s_capacity_it_is_an_overload_in_either_direction() -> None:
    for newtons in (500.0, -500.0):
        said = Ceilings(600.0, 5e3, 490.0).broken_by([(0.0, newtons)])
        assert said is not None and said.startswith(f"STOP: overload, {newtons:.0f} N on a load cell of 490 N")


def test_the_force_ceiling_follows_a_small_load_cell() -> None:
    small, usual = (parse_config({"load_cell": {"capacity_kg": kg}}, "this test") for kg in (10, 50))
    assert ceilings_of(small).force_n == pytest.approx(0.8 * 10 * 9.80665)
    assert (ceilings_of(usual).force_n, ceilings_of(usual).capacity_n) == (150.0, pytest.approx(50 * 9.80665))


def test_the_stages_of_a_trial_are_named_from_the_first_to_the_last() -> None:
    assert StaticGuide((1.0, 1.0), 7.0).stages == ("empty", "+1", "+2", "\u22122", "\u22121")
    assert SwingGuide("pull the spring", 20.0).stages == ("stand still", "swing", "rest")


def test_below_the_ceilings_nothing_is_said() -> None:
    assert Ceilings(150.0, 500.0).broken_by([(0.0, 0.0), (0.1, 40.0), (0.2, 80.0)]) is None
