"""The verdict on poses and motions of the simulated wearer, as recorded and as spoiled here."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from station.journal import read_journal, write_recorded
from station.messages.codes import ReasonCode
from station.protocol import TrialSpec
from station.session.fitted_judgement import judge_recording
from station.session.judgement import Judgement
from station.session.reviewer import adopt_recordings
from tests.station.wearer import CYCLES, SPECS, WearerSession

POSE, UNSUITED, TIGHT = SPECS


@pytest.fixture(scope="module")
def folder(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wearer's session with a journal, as the console finds it."""
    folder = tmp_path_factory.mktemp("judged")
    for path in wearer.folder.glob("*.mcap"):
        shutil.copy(path, folder)
    adopt_recordings(folder)
    return folder


@pytest.fixture
def judged(folder: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Judgement]:
    """The judgement of a trial that was changed after it was read."""

    def judge(spec: TrialSpec, change: Callable[[WearerTrial], WearerTrial] = lambda trial: trial) -> Judgement:
        monkeypatch.setattr(
            "station.session.wearer_findings.read_wearer_trial", lambda path: change(read_wearer_trial(path))
        )
        return judge_recording(folder, spec.file_name(1))

    return judge


def quantities(judgement: Judgement) -> dict[str, str]:
    return {row.quantity: row.this for row in judgement.rows}


def test_a_motion_is_drawn_with_its_elevation_its_emg_and_the_force_of_the_cord_alone(
    judged: Callable[..., Judgement],
) -> None:
    axes = "elevation [°]", "EMG [µV]", "cord [N]"
    shown = [[axis in judged(spec).drawing for axis in axes] for spec in (POSE, UNSUITED, TIGHT)]
    assert shown == [[False, False, False], [True, True, False], [True, True, True]]
    assert judged(UNSUITED).drawing.count('quiet dotted"') == CYCLES


def test_a_pose_is_accepted_with_its_largest_movement(judged: Callable[..., Judgement], wearer: WearerSession) -> None:
    judgement = judged(POSE)
    assert (judgement.title, judgement.advice, judgement.reasons, judgement.grade) == ("pose", "accept", (), "good")
    trial = read_wearer_trial(wearer.path(POSE))
    truth = wearer.person.markers(wearer.starts[trial.file] + trial.time)
    of_body = [wearer.person.labels.index(label) for label in trial.body.body]
    ranges = np.ptp(truth[:, of_body], axis=0).max(axis=1)
    moved, marker = quantities(judgement)["largest movement [mm]"].split(" ")
    assert marker == f"({trial.body.body[int(np.argmax(ranges))]})"
    assert float(moved) == pytest.approx(ranges.max(), abs=1.5)


def test_a_motion_is_accepted_with_its_cycles_force_and_emg(judged: Callable[..., Judgement]) -> None:
    judgement = judged(TIGHT)
    assert (judgement.title, judgement.reasons) == ("motion, suit, cord tight", ())
    shown = quantities(judgement)
    assert shown["cycles"] == f"{CYCLES} of {CYCLES}"
    low, high = map(float, shown["cord force, zero not removed [N]"].split(" to "))
    assert high - low > 20
    assert float(shown["EMG deltoid RMS [\u00b5V]"]) > 30
    assert "cord force, zero not removed [N]" not in quantities(judged(UNSUITED))


def test_a_motion_with_fewer_cycles_than_planned_is_to_be_redone(judged: Callable[..., Judgement]) -> None:
    def one_cycle_less(trial: WearerTrial) -> WearerTrial:
        return replace(trial, cycles=trial.cycles[1:])

    (reason,) = judged(UNSUITED, one_cycle_less).reasons
    assert (reason.code, reason.figures) == (ReasonCode.CYCLES_MISSING, {"found": CYCLES - 1, "planned": CYCLES})
    contraction = judged(
        UNSUITED, lambda trial: replace(one_cycle_less(trial), manifest=replace(trial.manifest, condition="mvc"))
    )
    assert contraction.reasons == (), "a maximal contraction has no cycles"


def test_a_marker_that_is_hidden_too_often_is_named(judged: Callable[..., Judgement]) -> None:
    def hide(trial: WearerTrial) -> WearerTrial:
        markers = trial.markers.copy()
        markers[: len(markers) // 5, trial.labels.index("EpM")] = np.nan
        return replace(trial, markers=markers)

    (reason,) = judged(POSE, hide).reasons
    assert (reason.code, reason.figures["markers"]) == (ReasonCode.MARKERS_HIDDEN, "EpM")


def test_a_pose_in_which_the_wearer_moves_is_to_be_redone(judged: Callable[..., Judgement]) -> None:
    def step_aside(trial: WearerTrial) -> WearerTrial:
        markers = trial.markers.copy()
        markers[len(markers) // 2 :, :, 0] += 0.2
        return replace(trial, markers=markers)

    (reason,) = judged(POSE, step_aside).reasons
    assert reason.code is ReasonCode.POSE_MOVES and reason.figures["range_mm"] == pytest.approx(200, abs=40)


def test_emg_without_signal_or_clock_is_to_be_redone(judged: Callable[..., Judgement]) -> None:
    def unplug(trial: WearerTrial) -> WearerTrial:
        assert trial.emg is not None
        values = trial.emg.values.copy()
        values[:, 1] = 0.0
        return replace(trial, emg=replace(trial.emg, values=values))

    (reason,) = judged(UNSUITED, unplug).reasons
    assert (reason.code, reason.figures["channel"], reason.figures["finding"]) == (
        ReasonCode.EMG_UNUSABLE,
        "trapezius",
        "flat",
    )
    (reason,) = judged(UNSUITED, lambda trial: replace(trial, emg=None)).reasons
    assert reason.code is ReasonCode.NO_EMG_CLOCK


def test_a_trial_that_the_recorder_did_not_accept_is_to_be_redone(folder: Path, tmp_path: Path) -> None:
    shutil.copytree(folder, tmp_path / "session")
    entry = next(entry for entry in read_journal(folder).recorded if entry.test == "pose")
    lossy = replace(entry, file="lossy.mcap", lost_samples=3)
    shutil.copy(folder / entry.file, tmp_path / "session" / lossy.file)
    write_recorded(tmp_path / "session", lossy)
    judgement = judge_recording(tmp_path / "session", lossy.file)
    assert [reason.code for reason in judgement.reasons] == [ReasonCode.LOST_SAMPLES]
    (tmp_path / "session" / lossy.file).write_bytes(b"no recording")
    judgement = judge_recording(tmp_path / "session", lossy.file)
    assert [reason.code for reason in judgement.reasons] == [ReasonCode.LOST_SAMPLES, ReasonCode.UNUSABLE]
