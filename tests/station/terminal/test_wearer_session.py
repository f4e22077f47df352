"""Trials of the simulated wearer, guided, judged and kept without a page."""

from __future__ import annotations

from pathlib import Path

import pytest

from station.bench.simulation import SimulatedBench, practice_settings
from station.config import StationConfig, parse_config
from station.journal import Setup, read_journal
from station.messages.codes import CueCode
from station.terminal.events import CueChanged, Event, NextTrial, TrialSkipped, VerdictGiven, Waiting, WarningRaised
from tests.station.terminal.practice import lead
from tests.station.wearer import CYCLES, wearer_config

SETUP = Setup("P01", "ab", (), 1, has_bounce=False, conditions=("unsuited",))


def wearer_practice() -> StationConfig:
    data = wearer_config().model_dump(mode="json")
    data["mocap"]["control"] = "start"
    return parse_config(data, "test")


@pytest.mark.slow
def test_the_pose_is_skipped_and_the_motion_recorded_judged_and_kept(tmp_path: Path) -> None:
    config, folder = wearer_practice(), tmp_path / "simulated" / "session"
    commands = iter(("skip", "arm"))

    def answer(event: Event) -> str | None:
        return next(commands) if isinstance(event, Waiting) else None

    with SimulatedBench(practice_settings(config), None, 3) as bench:
        output = lead(bench, bench.configure(config), folder, answer, SETUP)
    assert [(trial.test, trial.condition) for trial in output.of(NextTrial)] == [("pose", None), ("motion", "unsuited")]
    assert [skipped.test for skipped in output.of(TrialSkipped)] == ["pose"]
    cues = {cue.code for cue in output.of(CueChanged)}
    # A busy computer may poll past a phase of a fast simulation; tests of the guide itself check the sequence of cues.
    assert cues and cues <= {CueCode.RAISE_ARM, CueCode.LOWER_ARM, CueCode.MOTION_DONE}
    (verdict,) = output.of(VerdictGiven)
    assert (verdict.title, verdict.advice) == ("motion, without the suit", "accept")
    assert {row.quantity: row.this for row in verdict.rows}["cycles"] == f"{CYCLES} of {CYCLES}"
    (warning,) = output.of(WarningRaised)
    assert warning.code == "not_summed_up" and "no recording of a cuff" in warning.sentence
    assert [trial.condition for trial in read_journal(folder).recorded] == ["unsuited"]
