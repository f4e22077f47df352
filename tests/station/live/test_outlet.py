"""Live results: the outlet, confined to an interface and off by default; the table, with the hash of the recording."""

import csv
import hashlib
import json
import shutil
from pathlib import Path
from threading import Event

import numpy as np
import pandas as pd
import pytest

from recordings.reader import open_recording
from recordings.samples import Samples
from recordings.topics import MARKERS
from station.bench.view import Snapshot, TrialState
from station.config import LiveSection, parse_config
from station.live import outlet as outlet_module
from station.live.engine import LiveEngine, replay_live
from station.live.outlet import LslOutlet, OutletRefused, ResultFile, live_columns, live_path, live_row
from station.live.published import LiveDelivery
from station.live.subscription import LiveSubscription, find_address
from station.live.tap import LiveRequest, LiveTap
from station.messages.live_messages import LiveCode
from tests.drivers.pytest_on_loopback import passed_on_loopback
from tests.refusals import raises_refusal
from tests.station.command import Station
from tests.station.live.test_server import SETUP
from tests.station.live.trials import TIGHT, Collected, PartOfTrial, generic_plan, part_of, solve
from tests.station.wearer import WearerSession
from tests.timeout import scaled_timeout

FED_FRAMES, FRAMES = 150, 80
SHORTER_AT = 40


def test_the_outlet_is_off_and_refused_where_it_cannot_be_confined(monkeypatch: pytest.MonkeyPatch) -> None:
    assert LiveSection().outlet == "" and not LiveSection().enabled
    monkeypatch.setattr(outlet_module.sys, "platform", "win32")
    with raises_refusal(LiveCode.OUTLET_NOT_CONFINED, kind=OutletRefused):
        LslOutlet("live", "loopback").begin(SETUP)


def test_a_refused_outlet_is_a_finding_and_values_continue(wearer: WearerSession, tmp_path: Path) -> None:
    plan, part = generic_plan(wearer.config, tmp_path), part_of(wearer, 25)
    engine, kept = solve(plan, part, LslOutlet("x", "nowhere"))
    assert LiveCode.NO_OUTLET in kept.codes
    assert engine.solved == 25 == len(kept.values)


@pytest.mark.slow
def test_an_inlet_reads_the_values(tmp_path: Path) -> None:
    assert passed_on_loopback("tests/station/live/outlet_on_loopback.py", "test_", tmp_path) == 2


# The live process itself: started by the tap, watched by a view, closed with the hash of the recording.


@pytest.mark.slow
def test_a_trial_from_the_tap_to_view_and_file(wearer: WearerSession, tmp_path: Path) -> None:
    """Frames come faster than they are solved, so that some are left out: all of them are accounted for."""
    recording = Path(shutil.copy(wearer.path(TIGHT), tmp_path))
    data = wearer.config.model_dump(mode="json") | {"live": {"enabled": True}}
    request = LiveRequest(parse_config(data, "test"), tmp_path, TIGHT, 0)
    part = part_of(wearer, FED_FRAMES)
    pause = Event()
    with LiveTap(request) as tap:
        tap.show(Snapshot(TrialState.ARMED, streams=part.streams))
        for _ in range(round(scaled_timeout(120) / 0.05)):
            if (address := find_address(tmp_path)) is not None:
                break
            pause.wait(0.05)
        assert address is not None
        view = LiveSubscription(address)
        tap.show(Snapshot(TrialState.RECORDING, streams=part.streams, recording=recording))
        fed = [block for block in part.blocks() if block.stream == MARKERS]
        for item in part.items():
            if isinstance(item, Samples):
                tap.offer(item)
    assert tap.dropped == 0
    assert view.wait_until_over(scaled_timeout(60))
    updates = view.take()
    view.close()
    assert tap.wait(scaled_timeout(30)) and tap.exit_code == 0
    plain = json.loads(live_path(recording).with_suffix(".json").read_text(encoding="utf-8"))
    assert plain["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert plain["frames"] + plain["dropped_frames"] == len(fed) == FED_FRAMES
    rows = pd.read_csv(live_path(recording))
    assert plain["frames"] == len(rows) > 0
    shown = [update.values.frame for update in updates if update.values is not None]
    assert shown and set(shown) <= set(rows["frame"])
    assert find_address(tmp_path) is None


@pytest.fixture(scope="module")
def session(wearer: WearerSession, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Collected]:
    """A recording with its live result, and the values that were written."""
    folder = tmp_path_factory.mktemp("live") / "simulated" / "session"
    folder.mkdir(parents=True)
    recording = Path(shutil.copy(wearer.path(TIGHT), folder))
    prepared = generic_plan(wearer.config, folder)
    kept, file = Collected(), ResultFile(prepared.settings)

    def shorten(engine: LiveEngine) -> None:
        if engine.solved == SHORTER_AT and not kept.notes:
            engine.set_rest_length("rigid", 0.7)

    part = PartOfTrial(open_recording(recording), FRAMES)
    replay_live(part, prepared, sinks=[file, kept], commands=shorten)  # type: ignore[arg-type]
    file.close("the trial has ended", has_ended=True)
    return recording, kept


def test_table_and_description_are_those_of_the_values(
    session: tuple[Path, Collected], tmp_path: Path, station: Station
) -> None:
    recording, kept = session
    with live_path(recording).open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert kept.setup is not None
    names = [column.name for column in live_columns(kept.setup)]
    written = [[float(row[name]) for name in names] for row in rows]
    np.testing.assert_array_equal(written, [live_row(kept.setup, values) for values in kept.values])
    assert [(int(row["frame"]), row["outcome"], row["rigid/outcome"]) for row in rows] == [
        (values.frame, values.outcome, values.scenarios[1].outcome) for values in kept.values
    ]
    recording, kept = session
    plain = json.loads(live_path(recording).with_suffix(".json").read_text(encoding="utf-8"))
    assert plain["recording_sha256"] == hashlib.sha256(recording.read_bytes()).hexdigest()
    assert (plain["frames"], plain["dropped_frames"]) == (len(kept.values), 0)
    assert plain["units"]["rigid/cord_force"] == "N"
    assert plain["events"] == [{"kind": "rest_length", "text": "rigid: 0.7000 m"}]
    assert plain["versions"].keys() >= {"cuffstation", "numpy", "solver"}
    assert plain["origin"] == "simulated" and not plain["is_scaled"]
    recording, _ = session
    assert station("info", live_path(recording)).code == 1
    assert station("export", live_path(recording), "--to", "csv", "--output", tmp_path).code == 1


def test_a_killed_process_leaves_rows_and_a_cancelled_trial_none(
    session: tuple[Path, Collected], tmp_path: Path
) -> None:
    recording, kept = session
    file = ResultFile(LiveSection(), tmp_path)
    assert kept.setup is not None
    file.begin(kept.setup)
    file.begin_recording(recording)
    file.write(kept.values[0], LiveDelivery(1000.0, 0.152, 0.002, 100, 7, 1, 100.0))
    path = live_path(recording, tmp_path)
    rows = pd.read_csv(path)  # before it is closed
    assert [(row["frame"], row["dropped_frames"]) for _, row in rows.iterrows()] == [(kept.values[0].frame, 7)]
    file.close("the recorder has ended", has_ended=False)
    assert list(tmp_path.iterdir()) == [path]
    kept = session[1]
    assert kept.setup is not None
    file = ResultFile(LiveSection())
    file.begin(kept.setup)
    file.begin_recording(tmp_path / "cancelled.mcap")
    assert file.path is not None and file.path.exists()
    file.close("cancelled", has_ended=True)
    assert list((tmp_path / "live").iterdir()) == []
