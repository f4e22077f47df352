"""What an operator may correct in a session's protocol.toml."""

from __future__ import annotations

from pathlib import Path

import pytest

from fitting.protocol_file import ProtocolFileError, SessionProtocol, read_protocol


def _written(folder: Path, text: str) -> Path:
    (folder / "a.mcap").touch()
    (folder / "protocol.toml").write_text(text, encoding="utf-8")
    return folder


def test_a_session_without_the_file_is_as_configured(tmp_path: Path) -> None:
    assert read_protocol(tmp_path) == SessionProtocol()


def test_steps_and_weights_are_taken_from_the_file(tmp_path: Path) -> None:
    said = read_protocol(_written(tmp_path, 'step_masses_kg = [1, 2.5]\n[steps_s]\n"a.mcap" = [3.1, 12]\n'))
    assert said.step_masses == (1.0, 2.5)
    assert said.steps["a.mcap"] == (3.1, 12.0)


def test_steps_of_a_recording_are_those_of_what_was_recovered_from_it(tmp_path: Path) -> None:
    (tmp_path / "a.recovered.mcap").touch()
    text = '[steps_s]\n"a.mcap" = [3]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (3.0,)
    text += '"a.recovered.mcap" = [4]\n'
    assert read_protocol(_written(tmp_path, text)).steps["a.recovered.mcap"] == (4.0,)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("step_masses_kg = [1,", "is not valid TOML"),
        ("masses = [1]", "unknown key masses"),
        ("steps_s = [1]", "expected a table"),
        ("step_masses_kg = [1, -2]", "step_masses_kg.1 is -2, expected a number above 0"),
        ('step_masses_kg = "heavy"', "expected a list"),
        ('[steps_s]\n"a.mcap" = [3, 3]', "expected times that rise"),
        ('[steps_s]\n"a.mcap" = [3, nan]', "expected a finite number"),
        ('[steps_s]\n"b.mcap" = [3]', "names b.mcap, expected a recording beside it"),
    ],
)
def test_what_cannot_be_used_is_refused_in_a_sentence(tmp_path: Path, text: str, sentence: str) -> None:
    with pytest.raises(ProtocolFileError, match=sentence):
        read_protocol(_written(tmp_path, text))
