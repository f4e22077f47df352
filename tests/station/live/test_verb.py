"""`station live` on a recording and on a folder, and its table."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from rich.console import Console

from recordings.reader import open_recording
from recordings.samples import Event, Samples
from recordings.topics import MARKERS
from station.live.published import (
    NAN,
    LiveBest,
    LiveDelivery,
    LiveFinding,
    LiveRecent,
    LiveScenarioValues,
    LiveUpdate,
    LiveValues,
)
from station.live.terminal_view import LiveSummary, best_sentence, render
from station.messages.live_messages import LiveCode
from tests.station.command import Station
from tests.station.live.test_server import SETUP
from tests.station.wearer import SPECS, WearerSession


def frames_after_edge(path: Path) -> int:
    """Counted in the file, without the code under test."""
    count, has_begun = 0, False
    for item in open_recording(path).items():
        if isinstance(item, Event) and item.kind == "sync_edge":
            has_begun = True
        elif isinstance(item, Samples) and item.stream == MARKERS and has_begun:
            count += len(item.sample_numbers)
    return count


def test_the_result_of_a_recording_is_written(wearer: WearerSession, tmp_path: Path, station: Station) -> None:
    pose = wearer.path(SPECS[0])
    ran = station("live", pose, "--output", tmp_path, "--format", "json")
    plain = json.loads(ran.out)
    count = frames_after_edge(pose)
    assert ran.code == 0 and plain["frames"] == {"solved": count} and not plain["is_scaled"]
    assert [row["name"] for row in plain["scenarios"]] == ["slack", "rigid"]
    assert plain["scenarios"][0]["effort"] == pytest.approx(1.0)
    table, description = sorted(tmp_path.iterdir())
    rows = pd.read_csv(table)
    assert json.loads(description.read_text(encoding="utf-8"))["frames"] == len(rows) == count
    ratio = rows["rigid/effort"].mean() / rows["slack/effort"].mean()
    assert plain["scenarios"][1]["effort"] == pytest.approx(ratio)


def test_a_folder_without_a_running_trial_is_refused(tmp_path: Path, station: Station) -> None:
    ran = station("live", tmp_path)
    assert ran.code == 1 and LiveCode.UNREACHABLE in ran.err


def values() -> LiveValues:
    slack = LiveScenarioValues("solved", 0.2, 0.0, (0.5,), 0.0, (0.0, 300.0, 400.0))
    worn = LiveScenarioValues("solved", 0.15, 0.0, (0.4,), 42.0, (0.0, 0.0, 250.0))
    return LiveValues(
        1.0, 100, "solved", (0.1,), (0.0,), (0.0,), (slack, worn),
        recent=LiveRecent(3, {"slack": 1.0, "worn": 0.8}), best=LiveBest(0.7123, 0.0134, 0.91, 3),
    )  # fmt: skip


def test_table_and_sentence_show_relative_effort_age_findings_and_best_length() -> None:
    delivery = LiveDelivery(1000.0, 0.152, 0.002, 100, 7, 1, 100.0)
    update = LiveUpdate(values(), delivery, (LiveFinding("live.x", "a finding"),), SETUP.scenarios)
    out = io.StringIO()
    Console(file=out, width=120).print(render(SETUP, update, 1000.25))
    text = out.getvalue()
    assert all(
        figure in text for figure in ("0.700 m", "75 %", "80 %", "42 N", "500 N", "250 N", "0.40 s", "a finding")
    )
    assert "7 frames left out" in text and "generic" in text
    assert "0.71 ± 0.01 m" in best_sentence(values()) and "9 % less" in best_sentence(values())
    bound = replace(values(), best=LiveBest(0.75, NAN, 0.9, 2, edge=1))
    assert "at least 0.75 m" in best_sentence(bound)


def test_a_summary_is_of_the_frames_in_which_every_suit_is_solved() -> None:
    summary = LiveSummary()
    summary.begin(SETUP)
    unsolved = LiveScenarioValues("infeasible", NAN, NAN, (NAN,), NAN, (NAN,) * 3)
    for one in (values(), values(), replace(values(), scenarios=(values().scenarios[0], unsolved))):
        summary.write(one, LiveDelivery(0.0, 0.0, 0.0, 1, 0, 1, NAN))
    plain = summary.to_plain()
    assert not summary.is_whole
    np.testing.assert_allclose([row["effort"] for row in plain["scenarios"]], [1.0, 0.75])
    assert plain["best_rest_length_m"] == 0.7123
