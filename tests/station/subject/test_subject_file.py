"""subject.toml, and motion trials of the simulated person as the assessment reads them."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

from fitting.wearer.wearer_trial import read_wearer_trial
from station.subject.assessed_subject import worn_arm_cuff
from station.subject.subject_file import SUBJECT_FILE, Cord, Subject, read_subject, write_subject
from tests.station.wearer import SPECS, WearerSession

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


POSE, FREE, TIGHT = SPECS


def test_markers_are_where_the_person_had_them(wearer: WearerSession) -> None:
    trial = read_wearer_trial(wearer.path(FREE))
    truth = wearer.person.markers(wearer.starts[trial.file] + trial.time)
    recorded = [trial.labels.index(label) for label in trial.body.body]
    columns = [wearer.person.labels.index(label) for label in trial.body.body]
    error = 1e3 * trial.markers[:, recorded] - truth[:, columns]
    assert np.sqrt(np.nanmean(error**2)) < 0.5, "mm, of the cameras"


def test_the_tension_of_the_cord_is_there_where_it_was_measured(wearer: WearerSession) -> None:
    trial = read_wearer_trial(wearer.path(TIGHT))
    assert trial.body.is_cord_measured and 20 < np.ptp(trial.force) < 80


@pytest.mark.parametrize(
    ("named", "arms", "worn"),
    [
        ("tube", ["hand", "tube"], "tube"),
        (None, ["hand"], "hand"),
        (None, ["hand", "tube"], None),
        (None, [], None),
        ("", ["hand"], "hand"),
    ],
)
def test_the_cuff_that_is_worn_is_the_named_one_or_the_only_one(
    named: str | None, arms: list[str], worn: str | None
) -> None:
    assert worn_arm_cuff(named, arms) == worn
