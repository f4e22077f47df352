"""A new session takes over operator, plan, number and wearer from the earlier ones, as far as they still apply."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from station.config import StationConfig, parse_config
from station.journal import write_setup
from station.journal_lines import JOURNAL_FILE, Setup
from station.session.listing import EarlierSessions, list_sessions
from station.subject.subject_file import Cord, Subject, write_subject

CUFF = {"anchor_markers": ["a", "b", "c"], "cuff_markers": ["d"]}
BODY = {"markers": ["ij", "px", "c7"], "conditions": ["unsuited", "tight"]}


def config_of(*cuffs: str) -> StationConfig:
    data = {"cuffs": dict.fromkeys(cuffs, CUFF), "body": BODY, "protocol": {"repeats": 2, "step_masses_kg": [1.5]}}
    return parse_config(data, "test")


def add_session(folder: Path, setup: Setup, hour: int, wearer: Subject | None = None) -> None:
    session = folder / f"sub-{setup.subject}_ses-{setup.number}"
    write_setup(session, setup)
    if wearer is not None:
        write_subject(session, wearer)
    os.utime(session / JOURNAL_FILE, (3600 * hour, 3600 * hour))


def earlier(folder: Path, *cuffs: str) -> EarlierSessions:
    return EarlierSessions(list_sessions(folder), config_of(*cuffs))


def test_the_first_session_has_the_plan_of_the_configuration(tmp_path: Path) -> None:
    suggested = earlier(tmp_path, "hand", "waist")
    assert suggested.setup == Setup("", "", ("hand", "waist"), 2, False, "1", (1.5,), ("unsuited", "tight"))
    assert (suggested.number_of("P01"), suggested.wearer("P01")) == ("1", Subject())


def test_the_last_plan_is_suggested_without_what_the_configuration_no_longer_has(tmp_path: Path) -> None:
    add_session(tmp_path, Setup("P02", "late", ("waist", "tube"), 5, True, "1", (2.0, 2.0), ("slack",)), 2)
    add_session(tmp_path, Setup("P01", "early", ("hand",), 1), 1)
    expected = Setup("", "late", ("waist",), 5, False, "1", (2.0, 2.0), ("slack",))
    assert earlier(tmp_path, "hand", "waist").setup == expected


@pytest.mark.parametrize(("used", "suggested"), [(("1", "2"), "3"), (("3",), "4"), (("monday",), "1"), ((), "1")])
def test_the_next_number_of_the_subject_is_suggested(tmp_path: Path, used: tuple[str, ...], suggested: str) -> None:
    for hour, number in enumerate(used):
        add_session(tmp_path, Setup("P01", "", ("hand",), 1, number=number), hour)
    add_session(tmp_path, Setup("P02", "", ("hand",), 1, number="7"), 9)
    assert earlier(tmp_path, "hand").number_of("P01") == suggested


def test_the_laboratory_is_that_of_the_last_wearer_and_the_mass_of_the_same_one(tmp_path: Path) -> None:
    of_other = Subject(mass_kg=90.0, vertical="y", marker_set="isb", cord=Cord(rest_length_m=0.7, cuff="tube"))
    add_session(tmp_path, Setup("P01", "", ("hand",), 1), 1, Subject(mass_kg=61.5, hand_load_kg=2.0))
    add_session(tmp_path, Setup("P02", "", ("hand",), 1), 2, of_other)
    add_session(tmp_path, Setup("P02", "", ("hand",), 1, number="2"), 3)
    suggested = earlier(tmp_path, "hand").wearer("P01")
    assert suggested == Subject(mass_kg=61.5, vertical="y", marker_set="isb", cord=Cord(rest_length_m=0.7))
    assert earlier(tmp_path, "hand").wearer("P03").mass_kg is None
