from __future__ import annotations

from pathlib import Path

import pytest

from station.whole_file import drafted, write_whole


def test_a_text_with_a_name_that_is_not_utf_8_is_written_as_utf_8(tmp_path: Path) -> None:
    write_whole(tmp_path / "report.html", "session \udcff \u00b1")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "session ? \u00b1"


def test_a_failed_write_keeps_the_previous_file_and_names_it(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    write_whole(path, "before")
    with pytest.raises(OSError, match="No space left") as caught, drafted(path) as draft:
        draft.write_text("half")
        raise OSError(28, "No space left on device")
    assert caught.value.filename == str(path)
    assert path.read_text() == "before"
    assert [each.name for each in tmp_path.iterdir()] == ["cuffs.json"]
