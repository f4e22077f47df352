"""A pose and two motions of a wearer, recorded on the simulated bench."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from fitting.errors import UnusableTrial
from fitting.results.codes import RejectionCode
from fitting.trial.trial_reader import read_trial
from recordings.reader import open_recording
from station.files.timed_replay import replay
from station.fit import SessionError, fit_session_folder
from station.messages.setup_messages import FolderCode
from station.recordings_of_session import pulls_in
from tests.refusals import raises_refusal
from tests.station.command import Ran
from tests.station.wearer import BODY, SPECS, WearerSession

POSE, FREE, TIGHT = SPECS


def test_every_trial_is_complete_accepted_and_named_after_its_condition(wearer: WearerSession) -> None:
    assert list(wearer.results) == [
        "test-pose_run-1.mcap",
        "condition-unsuited_test-motion_run-1.mcap",
        "condition-tight_test-motion_run-1.mcap",
    ]
    for result in wearer.results.values():
        assert result.accepted and not result.lost_samples, result.sentence
        assert result.path is not None and open_recording(result.path).complete


def test_a_pose_ends_by_itself_and_a_motion_with_the_capture(wearer: WearerSession) -> None:
    ends = [[message.code for message in wearer.results[spec.file_name(1)].messages] for spec in SPECS]
    assert ends == [["duration_reached"], ["capture_ended"], ["capture_ended"]]


def test_the_manifest_has_markers_condition_and_emg_gains(wearer: WearerSession) -> None:
    manifests = {spec: open_recording(wearer.path(spec)).manifest for spec in SPECS}
    assert [manifest.condition for manifest in manifests.values()] == [None, "unsuited", "tight"]
    for spec, manifest in manifests.items():
        assert manifest.cuff is manifest.bounce is None
        assert manifest.body is not None and manifest.body.body == tuple(BODY["markers"])
        assert (manifest.body.is_cord_measured, bool(manifest.body.suit)) == (spec is TIGHT, spec is TIGHT)
        assert manifest.emg is not None and manifest.emg.gains == {"deltoid": 500.0, "trapezius": 500.0}
        assert manifest.protocol.cycles == 3


def test_emg_force_and_markers_are_in_the_file(wearer: WearerSession) -> None:
    recording = open_recording(wearer.path(TIGHT))
    force, sync, emg, markers = (recording.load(name) for name in ("/force", "/sync", "/emg", "/markers"))
    assert emg.stream.labels == ("deltoid", "trapezius")
    np.testing.assert_array_equal(emg.sample_numbers, sync.sample_numbers)
    seconds = len(emg.values) // 1000
    rms = np.sqrt(np.mean(emg.values[: seconds * 1000].reshape(seconds, 1000, 2) ** 2, axis=1))
    assert np.all(rms.max(axis=0) > 5 * rms.min(axis=0)), "active in the raises, silent between them"
    newtons = (force.values * recording.manifest.load_cell.newtons_per_unit).ravel()
    assert 20 < newtons.max() < 80, "the cord"
    cord = [markers.stream.labels.index(label) for label in BODY["suit_markers"]]
    assert np.isfinite(markers.values[:, cord]).mean() > 0.95


def test_a_replay_holds_the_same_samples_under_the_same_name(wearer: WearerSession, tmp_path: Path) -> None:
    for spec in (POSE, TIGHT):
        result = replay(wearer.path(spec), tmp_path, 500.0)
        assert result.accepted and result.path == tmp_path / spec.file_name(1), result.sentence
        before, after = open_recording(wearer.path(spec)), open_recording(result.path)
        assert (after.manifest.body, after.manifest.emg) == (before.manifest.body, before.manifest.emg)
        for stream in before.streams:
            once, again = before.load(stream.name), after.load(stream.name)
            np.testing.assert_array_equal(once.sample_numbers, again.sample_numbers)
            np.testing.assert_array_equal(once.values, again.values)


def test_no_fit_uses_a_pose_or_motion(wearer: WearerSession) -> None:
    assert pulls_in(wearer.folder) == []
    with raises_refusal(FolderCode.NO_RECORDING, kind=SessionError):
        fit_session_folder(wearer.folder, None)
    for spec in (POSE, TIGHT):
        with pytest.raises(UnusableTrial) as caught:
            read_trial(wearer.path(spec))
        assert caught.value.reason.code is RejectionCode.IS_WEARER_TRIAL


@pytest.mark.parametrize(
    "words",
    [
        ("--test", "motion"),
        ("--test", "motion", "--condition", "loose"),
        ("--test", "motion", "--condition", "tight", "--cuff", "hand"),
        ("--test", "static", "--cuff", "hand", "--condition", "tight"),
        ("--condition", "tight"),
    ],
)
def test_a_condition_needs_a_motion_and_a_cuff_needs_a_pull(
    station: Callable[..., Ran], words: tuple[str, ...]
) -> None:
    ran = station("record", "--config", "station.toml", "--session", "none", *words)
    assert (ran.code, ran.out) == (2, "")
