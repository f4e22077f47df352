"""What an operator may correct in a session's protocol.toml."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fitting.results.codes import FitErrorCode
from fitting.trial.mass_checks import MassCheck, evaluate_reading, with_mass_checks
from fitting.trial.trial import build_trial
from fitting.trial.trial_reader import SessionProtocol, read_protocol
from tests.fitting.experiment import Session, published
from tests.refusals import raises_refusal


def _written(folder: Path, text: str) -> Path:
    (folder / "a.mcap").touch()
    (folder / "protocol.toml").write_text(text, encoding="utf-8")
    return folder


def test_a_session_without_the_file_is_as_configured(tmp_path: Path) -> None:
    assert read_protocol(tmp_path) == SessionProtocol()


def test_steps_and_weights_are_taken_from_the_file(tmp_path: Path) -> None:
    protocol = read_protocol(_written(tmp_path, 'step_masses_kg = [1, 2.5]\n[steps_s]\n"a.mcap" = [3.1, 12]\n'))
    assert protocol.step_masses == (1.0, 2.5)
    assert protocol.steps["a.mcap"] == (3.1, 12.0)


def test_steps_of_a_recording_are_those_of_what_was_recovered_from_it(tmp_path: Path) -> None:
    (tmp_path / "a.recovered.mcap").touch()
    text = '[steps_s]\n"a.mcap" = [3]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (3.0,)
    text += '"a.recovered.mcap" = [4]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (4.0,)


@pytest.mark.parametrize(
    ("text", "key"),
    [
        ("masses = [1]", "masses"),
        ("steps_s = [1]", "steps_s"),
        ("step_masses_kg = [1, -2]", "step_masses_kg.1"),
        ('step_masses_kg = "heavy"', "step_masses_kg"),
        ('[steps_s]\n"a.mcap" = [3, 3]', "steps_s.a.mcap"),
        ('[steps_s]\n"a.mcap" = [3, nan]', "steps_s.a.mcap.1"),
    ],
)
def test_a_wrong_value_is_refused_with_its_key(tmp_path: Path, text: str, key: str) -> None:
    with raises_refusal(FitErrorCode.PROTOCOL_INVALID, file=str(tmp_path / "protocol.toml"), key=key):
        read_protocol(_written(tmp_path, text))


def test_a_file_that_is_not_toml_is_refused(tmp_path: Path) -> None:
    with raises_refusal(FitErrorCode.PROTOCOL_NOT_TOML, file=str(tmp_path / "protocol.toml")):
        read_protocol(_written(tmp_path, "step_masses_kg = [1,"))


def test_steps_of_an_unknown_recording_are_refused(tmp_path: Path) -> None:
    with raises_refusal(FitErrorCode.PROTOCOL_NO_RECORDING, recording="b.mcap"):
        read_protocol(_written(tmp_path, '[steps_s]\n"b.mcap" = [3]'))


# Readings of a known mass: their uncertainty, their tolerance, the drift between them, and what they prove.


def test_readings_that_agree_change_nothing() -> None:
    checks = [MassCheck("", 2.0, 19.613, 19.60, 0.02, 0.1), MassCheck("", 2.0, 19.613, 19.63, 0.02, 0.4)]
    trial = build_trial(*Session(published("hand", weights=(20.0,), hold=2.0), 3).static(), "a.mcap", "hash")
    (checked,) = with_mass_checks([trial], checks)
    assert (checked.gain_sd, checked.is_gain_checked) == (trial.gain_sd, True)


@pytest.mark.parametrize(
    "checks",
    [
        [],
        [MassCheck("", 0.0, 0.0, 0.1, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, None)],
        [MassCheck("", 2.0, 19.613, 19.6, 0.02, 0.1), MassCheck("", 2.0, 19.613, 21.6, 0.02, 0.1)],
    ],
    ids=["no reading", "the empty cell alone", "no zero", "one reading is wrong"],
)
def test_the_gain_is_checked_by_readings_of_a_mass_that_are_all_right(checks: list[MassCheck]) -> None:
    trial = build_trial(*Session(published("hand", weights=(20.0,), hold=2.0), 3).static(), "a.mcap", "hash")
    assert not with_mass_checks([trial], checks)[0].is_gain_checked


def test_a_reading_is_without_the_zero_and_holds_its_uncertainty() -> None:
    noise = np.random.default_rng(1).standard_normal(6000)
    zero = evaluate_reading(3.0 + 0.1 * noise, 0.0, None)
    loaded = evaluate_reading(22.613 + 0.1 * noise[::-1], 2.0, zero)
    assert loaded.expected == pytest.approx(19.6133)
    assert loaded.found == pytest.approx(19.613, abs=4 * loaded.sd)
    assert zero.sd == pytest.approx(0.1 / np.sqrt(6000), rel=0.7)
    assert loaded.sd > zero.sd


def test_a_reading_may_be_off_by_its_uncertainty_the_scale_s_and_a_part_of_the_weight() -> None:
    check = MassCheck("", 2.0, 20.0, 20.0, 0.03, 0.0)
    assert check.tolerance(0.002, 50.0) == pytest.approx(3 * 0.05 + 0.2)
    empty = MassCheck("", 0.0, 0.0, 1.0, 0.0, None)
    assert empty.tolerance(0.002, 50.0) == pytest.approx(0.05 * 50 * 9.80665)


def test_too_few_samples_are_no_reading() -> None:
    with raises_refusal(FitErrorCode.CHECK_SHORT, samples=5, expected=6):
        evaluate_reading(np.zeros(5), 1.0, None)
