"""The set-up of EMG: the default fits the bundled model, and a wrong name is refused with similar ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from fitting.emg.envelope import LINEAR_ENVELOPE, PUBLISHED, EnvelopeSettings
from solver.bundled import bundled_model
from station.config import ConfigError
from station.emg.trials import read_emg_setup
from station.messages.emg_codes import EmgCode
from tests.station.refusals import raises_refusal


def setup_of(folder: Path, text: str):
    path = folder / "emg.toml"
    path.write_text(text, encoding="utf-8")
    return read_emg_setup(path)


def test_the_default_has_the_defaults_of_the_code_and_muscles_of_the_bundled_model() -> None:
    setup = read_emg_setup(None)
    assert setup.envelope.settings() == LINEAR_ENVELOPE
    assert set(setup.channels) >= {"AD", "MD", "PD", "TS", "TM", "TI", "Infra", "SA", "LatD", "PM_Clav", "TMajor"}
    setup.require_muscles(setup.channels, bundled_model().muscle_names, "the bundled model")


def test_a_set_up_overrides_the_defaults_key_by_key(tmp_path: Path) -> None:
    assert setup_of(tmp_path, '[envelope]\nmethod = "seth_2019"\n').envelope.settings() == PUBLISHED
    setup = setup_of(tmp_path, '[envelope]\nmethod = "rms"\nwindow_s = 0.2\n[channels]\nX = { muscles = ["A"] }\n')
    assert setup.envelope.settings() == EnvelopeSettings(smoothing="rms", window_s=0.2)
    assert list(setup.channels) == ["X"]


def test_several_muscles_are_combined() -> None:
    setup = read_emg_setup(None)
    activations = np.array([[0.1, 0.2, 0.6], [0.3, 0.3, 0.3]])
    serratus = setup.channels["SA"]
    assert serratus.combined(activations) == pytest.approx([0.3, 0.3])
    assert serratus.model_copy(update={"combine": "max"}).combined(activations) == pytest.approx([0.6, 0.3])
    assert serratus.model_copy(update={"weights": (1.0, 0.0, 3.0)}).combined(activations) == pytest.approx([0.475, 0.3])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[channels]\nAD = {}\n", "channels.AD.muscles is missing"),
        ("[envelope]\nmethod = 'seth_2019'\nlow_pass_hz = 6.0\n", "low_pass_hz is not used by the method seth_2019"),
        ("[envelope]\nband_hz = [450.0, 20.0]\n", "expected the lower cut-off first"),
        ("[channels]\nAD = { muscles = ['A', 'B'], weights = [1] }\n", "weights need one value for each muscle"),
        ("[channels]\nAD = { muscles = ['A'], combine = 'max', weights = [1] }\n", "combine = 'mean'"),
        ("[chanels]\n", "unknown key chanels"),
        ("[file]\nunit = 'kV'\n", "file.unit is 'kV'"),
    ],
)
def test_a_wrong_set_up_is_refused_with_its_key(tmp_path: Path, text: str, reason: str) -> None:
    with raises_refusal(ConfigError, EmgCode.SETUP_WRONG) as caught:
        setup_of(tmp_path, text)
    assert reason in caught.value.cause.figures["reason"]


def test_an_unknown_name_is_refused_with_similar_names() -> None:
    setup = read_emg_setup(None)
    with raises_refusal(ConfigError, EmgCode.UNKNOWN_CHANNEL) as caught:
        setup.require_channels(["LAD", "serratus"], "emg.csv")
    assert caught.value.cause.figures["name"] == "AD" and "LAD" in caught.value.cause.figures["known"]
    with raises_refusal(ConfigError, EmgCode.UNKNOWN_MUSCLE) as caught:
        setup.require_muscles(["AD"], ["TRIlong", "DeltoideusClavicle_B"], "act.sto")
    figures = caught.value.cause.figures
    assert figures["name"] == "DeltoideusClavicle_A" and "DeltoideusClavicle_B" in figures["known"]
