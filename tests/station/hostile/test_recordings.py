"""Recordings made to exhaust their reader: every verb ends within its limits, and keeps the readable part."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.recordings.bombs import BOMBS
from tests.station.hostile.bounded import assert_ends_within_limits

EXCESSIVE = ("events", "empty records", "zeros")
"""Correct to the last CRC and too large, so that they are refused as a whole."""
REFUSALS = [
    pytest.param(name, verb, marks=[] if verb == "info" or name == "zeros" else [pytest.mark.slow])
    for name in EXCESSIVE
    for verb in ("info", "recover", "fit", "export")
]
"""By default every bomb is opened once, and every verb opens one."""


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A session's folder for each bomb."""
    folders = {name: tmp_path_factory.mktemp("session") for name in BOMBS}
    for name, folder in folders.items():
        BOMBS[name](folder / "a.mcap")
    return folders


@pytest.mark.parametrize(("name", "verb"), REFUSALS)
def test_a_bomb_is_refused_by_every_verb(sessions: dict[str, Path], name: str, verb: str, tmp_path: Path) -> None:
    path = sessions[name] / "a.mcap"
    words: dict[str, tuple[object, ...]] = {
        "info": (path,),
        "recover": (path, "--output", tmp_path / "b.mcap"),
        "fit": (sessions[name],),
        "export": ("--session", sessions[name], "--to", "csv", "--output", tmp_path / "exported"),
    }
    ran = assert_ends_within_limits(verb, *words[verb], folder=tmp_path)
    assert ran.code == 1 and "a.mcap" in ran.err
    assert not (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize("name", [name for name in BOMBS if name not in EXCESSIVE])
def test_the_content_before_a_bomb_is_shown(sessions: dict[str, Path], name: str, tmp_path: Path) -> None:
    ran = assert_ends_within_limits("info", sessions[name] / "a.mcap", folder=tmp_path, codes=(1, 3))
    assert ran.out or "1000000 samples" in ran.err
