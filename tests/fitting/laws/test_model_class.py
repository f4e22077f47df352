"""The comparison of laws on donnings whose law is known."""

import numpy as np
import pytest

from fitting.laws.model_class import KELVIN_VOIGT, ModelComparison, SampledPull, compare_classes, sample_pull
from fitting.session import fit_session
from fitting.trial.trial import build_trial
from tests.fitting.defects import Law, OddSession, Rig
from tests.fitting.experiment import Session, Truth, published

STRONG = {
    "stiffening": Law(stiffness=4520.0, bend=99.7),
    "friction": Law(friction=3.0),
    "standard linear solid": Law(fast=(0.4, 0.15)),
    "creep": Law(slow=(0.15, 15.0)),
    "slip": Law(slip_from=45.0),
}
WEAK = {
    "stiffening": Law(bend=12.0),
    "friction": Law(friction=0.6),
    "standard linear solid": Law(fast=(0.08, 0.15)),
    "creep": Law(slow=(0.03, 15.0)),
    "slip": Law(slip_from=60.0),
}
RIGS = (
    {"lag": 25e-3},
    {"zero_drift": -2 / 60, "lag": -5e-3},
    {"lag": 5e-3},
    {"lag": -5e-3},
    {"zero_drift": 2 / 60},
    {"zero_drift": -2 / 60, "lag": 5e-3},
)


def _compared(session: Session, repeats: int) -> ModelComparison:
    trials = []
    for repeat in range(1, repeats + 1):
        trials.append(build_trial(*session.static(repeat), f"s{repeat}", "s"))
        trials.append(build_trial(*session.dynamic(repeat), f"d{repeat}", "d"))
    fitted = fit_session(trials)
    (fit,) = fitted.cuffs.values()
    assert fit.classes
    return fit.classes


def _donning(law: Law, seed: int = 1, repeats: int = 2, **rig: float) -> ModelComparison:
    truth = Truth(friction=1e9, migration=0.0, duration=16.0, hold=6.0, **rig)  # type: ignore[arg-type]
    return _compared(OddSession(law, Rig(), seed, truth), repeats)


@pytest.mark.parametrize(
    ("rig", "repeats"),
    [
        pytest.param(rig, repeats, marks=[pytest.mark.slow] * (index > 1 or repeats > 1))
        for index, rig in enumerate(RIGS)
        for repeats in (1, 2)
    ],
)
def test_an_uncalibrated_lag_and_a_drift_of_the_zero_are_no_law(rig: dict[str, float], repeats: int) -> None:
    """The waist's damper is so strong that a lag makes the swing look stiffer than the held loads."""
    assert _donning(Law(stiffness=2140.0, damping=124.0), 1, repeats, **rig).name == KELVIN_VOIGT


@pytest.mark.slow
@pytest.mark.parametrize("name", STRONG)
def test_a_law_that_is_richer_is_recognised(name: str) -> None:
    """From two repeats; tests/fitting/diagnosis/test_causes.py expects the same from one."""
    found = _donning(STRONG[name])
    assert found.chosen[0] == name
    assert found.ranking[0].gain > 0.25


@pytest.mark.parametrize(
    "name", ["slip", *(pytest.param(name, marks=pytest.mark.slow) for name in WEAK if name != "slip")]
)
def test_a_fifth_of_the_effect_is_enough(name: str) -> None:
    """A few per cent of creep and a friction of a few tenths of a newton may tie."""
    found = _donning(WEAK[name], repeats=3)
    gains = {score.name: score.gain for score in found.ranking}
    assert found.chosen
    assert gains[name] > found.ranking[0].gain - 0.01


def test_slip_in_the_first_repeat_only_is_slip() -> None:
    found = _compared(Session(published("hand", hold=4.0, duration=12.0), 2), 2)
    assert found.chosen == ("slip",)
    assert found.ranking[0].name == "slip"


def test_two_effects_at_once_are_both_named() -> None:
    both = _donning(Law(fast=(0.4, 0.15), slow=(0.3, 15.0)))
    assert set(both.chosen) == {"standard linear solid", "creep"}


def _still(force: np.ndarray) -> SampledPull:
    n = len(force)
    still = np.zeros(n)
    return SampledPull(
        time=np.arange(n) * 0.04,
        force=force,
        drifts=True,
        force_rate=still,
        lag_sd=0.01,
        displacement=still,
        velocity=still,
        kept=np.ones(n, bool),
        is_held=False,
        repeat=1,
        play=1e-4,
    )


def test_without_a_load_there_is_nothing_to_compare() -> None:
    assert compare_classes([]) is None
    assert compare_classes([_still(np.zeros(500))]) is None


def test_a_sampled_pull_keeps_the_swing_and_interpolates_hidden_frames() -> None:
    session = Session(published("hand", hold=4.0, duration=14.0, occlusion=0.1), 3)
    fitted = fit_session([build_trial(*session.static(), "s", "s"), build_trial(*session.dynamic(), "d", "d")])
    swing, held_loads = fitted.pulls["d"], fitted.pulls["s"]
    swung = sample_pull(swing.pull, (), swing.oscillation)
    assert np.isfinite(swung.displacement).all()
    kept = swung.time[swung.kept]
    assert swing.oscillation.start <= kept[0] <= kept[-1] <= swing.oscillation.end
    assert not swung.is_held
    held = sample_pull(held_loads.pull, held_loads.plateaus, None)
    assert held.is_held
    assert 0.3 < held.kept.mean() < 0.95
    assert 2e-5 < held.play < 2e-4
