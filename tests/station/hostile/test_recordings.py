"""Recordings made to exhaust their reader: every verb ends in a sentence within its limits, and keeps what it can."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recordings.bombs import BOMBS
from tests.station.hostile.bounded import assert_ends_in_a_sentence

EXCESSIVE = ("events", "empty records", "zeros")
"""What these hold is right to the last CRC and merely too much, so that they are refused as a whole."""


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A session's folder for each bomb."""
    folders = {name: tmp_path_factory.mktemp("session") for name in BOMBS}
    for name, folder in folders.items():
        BOMBS[name](folder / "a.mcap")
    return folders


@pytest.mark.parametrize("name", EXCESSIVE)
@pytest.mark.parametrize("verb", ["info", "recover", "fit", "export"])
def test_a_bomb_is_refused_by_every_verb(sessions: dict[str, Path], name: str, verb: str, tmp_path: Path) -> None:
    path = sessions[name] / "a.mcap"
    words: dict[str, tuple[object, ...]] = {
        "info": (path,),
        "recover": (path, "--output", tmp_path / "b.mcap"),
        "fit": (sessions[name],),
        "export": ("--session", sessions[name], "--to", "csv", "--output", tmp_path / "out"),
    }
    ran = assert_ends_in_a_sentence(verb, *words[verb], folder=tmp_path)
    assert "no recorder wrote it" in ran.err
    assert not (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize("name", [name for name in BOMBS if name not in EXCESSIVE])
def test_what_is_before_a_bomb_is_told(sessions: dict[str, Path], name: str, tmp_path: Path) -> None:
    ran = assert_ends_in_a_sentence("info", sessions[name] / "a.mcap", folder=tmp_path, codes=(1, 3))
    assert ran.out or "announces 1000000 samples without a value" in ran.err
