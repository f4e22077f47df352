"""What an operator may correct in a session's protocol.toml."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.results.codes import FitErrorCode
from fitting.trial.trial_reader import SessionProtocol, read_protocol
from tests.fitting.refusals import raises_refusal


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
