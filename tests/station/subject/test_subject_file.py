from __future__ import annotations

import tomllib
from pathlib import Path

import pytest

from station.subject.subject_file import SUBJECT_FILE, Cord, Subject, read_subject, write_subject

MARKED = Subject(mass_kg=61.5, vertical="y", markers={"acro mion": "aa", 'Él\u007f\t"': "ij"})
CORDED = Subject(
    mass_kg=75, hand_load_kg=2.0, marker_set=r"C:\sets\own.toml", cord=Cord(rest_length_m=0.73, cuff="hand")
)


@pytest.mark.parametrize(
    "subject", [Subject(), MARKED, CORDED, Subject(cord=Cord(rest_length_m=0.7)), Subject(cord=Cord(cuff="hand"))]
)
def test_a_wearer_is_read_as_written(subject: Subject, tmp_path: Path) -> None:
    write_subject(tmp_path, subject)
    assert read_subject(tmp_path) == subject


def test_what_is_not_known_is_left_out(tmp_path: Path) -> None:
    write_subject(tmp_path, Subject(vertical="y"))
    assert tomllib.loads((tmp_path / SUBJECT_FILE).read_text()) == {"hand_load_kg": 0.0, "vertical": "y"}
