"""A recording of the wearer on one clock, from the streams of test_analog_signals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.wearer.wearer_trial import build_wearer_trial
from recordings.manifest import BodyMarkers, EmgAmplifier
from tests.fitting.refusals import raises_refusal
from tests.fitting.trial.test_analog_signals import LABELS, MANIFEST, recorded


def test_markers_are_metres_and_emg_is_beside_them() -> None:
    tracks = recorded()
    trial = build_wearer_trial(MANIFEST, tracks, "a.mcap", "0" * 64)
    np.testing.assert_allclose(trial.markers[0], 1e-3 * tracks["/markers"].values[0, :, :3], rtol=1e-6)
    assert trial.emg is not None and trial.emg.labels == ("a", "b")
    assert trial.elevation is None and trial.cycles == () and trial.is_whole


def test_emg_without_a_common_clock_is_left_out_with_a_note_and_the_markers_stay() -> None:
    trial = build_wearer_trial(replace(MANIFEST, emg=EmgAmplifier("lsl")), recorded(), "a.mcap", "0" * 64)
    assert trial.emg is None
    assert len(trial.time) and TrialNoteCode.EMG_LEFT_OUT in [note.code for note in trial.notes]


def test_hidden_markers_are_counted() -> None:
    tracks = recorded()
    values = tracks["/markers"].values.copy()
    values[250:500, 2] = np.nan
    tracks["/markers"] = replace(tracks["/markers"], values=values)
    hidden = build_wearer_trial(MANIFEST, tracks, "a.mcap", "0" * 64).hidden()
    assert hidden == pytest.approx(dict.fromkeys(LABELS, 0.0) | {LABELS[2]: 0.25}, abs=0.01)


@pytest.mark.parametrize(
    ("body", "code", "figures"),
    [
        (None, RejectionCode.NO_BODY, {"file": "a.mcap"}),
        (BodyMarkers(("c7", "nose")), RejectionCode.MISSING_MARKERS, {"missing": "nose"}),
    ],
)
def test_what_is_no_wearer_or_lacks_his_markers_is_refused(
    body: BodyMarkers | None, code: RejectionCode, figures: dict[str, str]
) -> None:
    with raises_refusal(code, **figures):
        build_wearer_trial(replace(MANIFEST, body=body), recorded(), "a.mcap", "0" * 64)
