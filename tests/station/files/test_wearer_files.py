"""Info and replay of a recorded motion of the wearer."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np

from fitting.wearer.wearer_trial import read_wearer_trial
from recordings.reader import open_recording
from tests.station.wearer import BODY, SPECS, WearerSession

TIGHT = SPECS[-1]


def test_info_names_markers_elevation_and_emg_of_a_motion(station, wearer: WearerSession) -> None:
    table, plain = station("info", wearer.path(TIGHT)), station("info", wearer.path(TIGHT), "--format", "json")
    assert (table.code, plain.code) == (0, 0)
    for text in (*BODY["markers"], *BODY["suit_markers"], "ac to EpL relative to c7 to t8", "deltoid ×500"):
        assert text in table.out
    assert set(json.loads(plain.out)["topics"]) >= {"/emg", "/force", "/markers"}


def test_markers_that_a_trial_does_not_need_are_not_occluded_in_it(station, wearer: WearerSession) -> None:
    assert "cord_" not in station("info", wearer.path(SPECS[1])).out, "the suit is not worn"


def test_a_replayed_motion_is_the_same_trial_and_is_drawn(station, wearer: WearerSession, tmp_path: Path) -> None:
    rrd, folder = tmp_path / "motion.rrd", tmp_path / "simulated" / "again"
    ran = station("replay", wearer.path(TIGHT), "--session", folder, "--speed", 500, "--rrd", rrd)
    assert ran.code == 0, ran.err
    before, after = (read_wearer_trial(path) for path in (wearer.path(TIGHT), folder / TIGHT.file_name(1)))
    assert before.emg is not None and after.emg is not None
    np.testing.assert_array_equal(after.emg.values, before.emg.values)
    np.testing.assert_array_equal(after.emg.time, before.emg.time)
    np.testing.assert_array_equal(after.markers, before.markers)
    assert after.cycles == before.cycles
    assert open_recording(folder / TIGHT.file_name(1)).manifest.emg == before.manifest.emg
    content = rrd.read_bytes()
    assert b"/wearer/elevation_deg" in content and b"/wearer/emg_uv/deltoid" in content
