"""Live results last: in a file of their own, with the hash of the recording, never taken for a recording."""

from __future__ import annotations

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from mcap.reader import make_reader

from recordings import live_result
from recordings.errors import RecordingCode, RecordingError
from recordings.live_result import PROFILE, is_live_result, read_live_result
from recordings.reader import open_recording, survey_file
from station.config import LiveSection
from station.live.engine import LiveEngine
from station.live.outlet import live_columns, live_row
from station.live.plan import PreparedTrial
from station.live.replay import replay_live
from station.live.result_file import ResultFile, live_path, live_results_in
from station.messages.file_codes import ExportCode
from station.recordings_of_session import originals_in
from tests.station.command import Ran
from tests.station.live.trials import TIGHT, Collected, PartOfTrial, generic_plan
from tests.station.wearer import WearerSession

FRAMES = 80
SHORTER_AT = 40


@pytest.fixture(scope="module")
def session(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Collected]:
    """A folder with the recording and its live result, and the values that were written."""
    folder = tmp_path_factory.mktemp("live") / "simulated" / "session"
    folder.mkdir(parents=True)
    recording = Path(shutil.copy(wearer.path(TIGHT), folder))
    prepared: PreparedTrial = generic_plan(wearer.config, folder)
    kept, file = Collected(), ResultFile(prepared.settings)

    def shorten(engine: LiveEngine) -> None:
        if engine.solved == SHORTER_AT and not kept.notes:
            engine.set_rest_length("rigid", 0.7)

    part = PartOfTrial(open_recording(recording), FRAMES)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(live_result, "FLUSH_AFTER_S", 0.0)  # every message is a chunk
        replay_live(part, prepared, sinks=[file, kept], commands=shorten)  # type: ignore[arg-type]
        file.close("the trial has ended", has_ended=True)
    return recording, kept


def test_the_file_holds_what_was_published_and_the_hash_of_the_recording(session: tuple[Path, Collected]) -> None:
    recording, kept = session
    result = read_live_result(live_path(recording))
    assert kept.setup is not None and result.is_complete and result.outcome is not None
    assert result.outcome.recording_sha256 == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert list(result.manifest.columns) == [column.name for column in live_columns(kept.setup)]
    written = np.array([live_row(kept.setup, values) for values in kept.values])
    np.testing.assert_array_equal(result.values, written)
    assert [frame.outcome for frame in result.frames] == [values.outcome for values in kept.values]
    assert [(event.kind, event.text) for event in result.events] == [("rest_length", "rigid: 0.7000 m")]
    assert result.manifest.versions.keys() >= {"cuffstation", "numpy", "solver"}
    assert result.manifest.origin == "simulated" and not result.manifest.is_scaled


def test_another_program_reads_the_file(session: tuple[Path, Collected]) -> None:
    """The reference reader of MCAP."""
    recording, kept = session
    with live_path(recording).open("rb") as file:
        reader = make_reader(file)
        assert reader.get_header().profile == PROFILE
        summary = reader.get_summary()
    assert summary is not None and summary.statistics is not None
    counts = {summary.channels[number].topic: n for number, n in summary.statistics.channel_message_counts.items()}
    assert counts == {"/live_manifest": 1, "/live_values": len(kept.values), "/live_events": 1, "/live_outcome": 1}


def test_it_is_not_taken_for_a_recording(session: tuple[Path, Collected]) -> None:
    recording, _ = session
    assert is_live_result(live_path(recording)) and not is_live_result(recording)
    assert originals_in(recording.parent) == [recording] or not originals_in(recording.parent)
    assert live_results_in(recording.parent) == [live_path(recording)]
    with pytest.raises(RecordingError) as refused:
        survey_file(live_path(recording))
    assert refused.value.code == RecordingCode.OTHER_PROGRAM
    with pytest.raises(RecordingError):
        read_live_result(recording)


def test_a_file_whose_process_was_killed_is_incomplete_and_can_be_recovered(
    session: tuple[Path, Collected], tmp_path: Path, station: Callable[..., Ran]
) -> None:
    """Cut anywhere: whole chunks are kept, and the frames are the first ones."""
    recording, kept = session
    whole = live_path(recording).read_bytes()
    cut = tmp_path / "live" / live_path(recording).name
    cut.parent.mkdir()
    cut.write_bytes(whole[: len(whole) // 2])
    result = read_live_result(cut)
    assert result.outcome is None and not result.is_complete
    assert 0.2 * FRAMES < len(result.frames) < 0.7 * FRAMES
    ran = station("recover", cut)
    assert ran.code == 3
    recovered = read_live_result(Path(ran.out.strip()))
    assert not recovered.is_complete and len(recovered.frames) == len(result.frames)
    frames = [values.frame for values in kept.values]
    assert [frame.frame for frame in recovered.frames] == frames[: len(recovered.frames)]
    assert station("info", cut).code == 3
    exported = station("export", cut, "--to", "csv", "--output", tmp_path, "--format", "json")
    assert exported.code == 3
    assert [note["code"] for note in json.loads(exported.out)["note_codes"]] == [ExportCode.INCOMPLETE]


def test_info_shows_both(session: tuple[Path, Collected], station: Callable[..., Ran]) -> None:
    recording, kept = session
    plain = json.loads(station("info", recording, "--format", "json").out)["live_result"]
    assert (plain["standing"], plain["frames"], plain["result"]) == ("complete", len(kept.values), "live")
    ran = station("info", live_path(recording), "--format", "json")
    assert ran.code == 0 and json.loads(ran.out)["recording"] == recording.name
    assert "LIVE RESULT" in station("info", live_path(recording)).out


def test_a_recording_that_has_changed_since_is_reported(
    session: tuple[Path, Collected], tmp_path: Path, station: Callable[..., Ran]
) -> None:
    recording, _ = session
    copied = tmp_path / "simulated"
    shutil.copytree(recording.parent, copied)
    (copied / recording.name).write_bytes(recording.read_bytes()[:-1])
    plain = json.loads(station("info", live_path(copied / recording.name), "--format", "json").out)
    assert plain["standing"] == "other_recording"


def test_the_export_is_a_table_with_units(
    session: tuple[Path, Collected], tmp_path: Path, station: Callable[..., Ran]
) -> None:
    recording, kept = session
    assert kept.setup is not None
    ran = station("export", live_path(recording), "--to", "csv", "--output", tmp_path)
    assert ran.code == 0
    table, description = (Path(line) for line in ran.out.split())
    rows = pd.read_csv(table)
    assert len(rows) == len(kept.values)
    np.testing.assert_array_equal(rows["rigid/cord_force"], [one.scenarios[1].cord_force_n for one in kept.values])
    assert json.loads(description.read_text())["units"]["rigid/cord_force"] == "N"
    parquet = Path(station("export", live_path(recording), "--to", "parquet", "--output", tmp_path).out.strip())
    pd.testing.assert_frame_equal(pd.read_parquet(parquet)[rows.columns], rows, check_exact=True)
    assert station("export", live_path(recording), "--to", "trc", "--output", tmp_path).code != 0


def test_a_trial_that_was_not_recorded_leaves_no_file(session: tuple[Path, Collected], tmp_path: Path) -> None:
    kept = session[1]
    assert kept.setup is not None
    file = ResultFile(LiveSection())
    file.begin(kept.setup)
    file.begin_recording(tmp_path / "cancelled.mcap")
    assert file.path is not None and file.path.exists()
    file.close("cancelled", has_ended=True)
    assert not live_path(tmp_path / "cancelled.mcap").exists()


def test_a_recorder_that_was_killed_leaves_an_incomplete_file(session: tuple[Path, Collected], tmp_path: Path) -> None:
    recording, kept = session
    assert kept.setup is not None
    copied = Path(shutil.copy(recording, tmp_path))
    file = ResultFile(LiveSection())
    file.begin(kept.setup)
    file.begin_recording(copied)
    file.close("the recorder has ended", has_ended=False)
    result = read_live_result(live_path(copied))
    assert result.outcome is not None and not result.is_complete and result.outcome.recording_sha256 == ""
