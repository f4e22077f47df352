"""Bits that flip in a stored recording: the fit names the damage first, diagnoses nothing else, and ends with 3."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from drivers.simulators.bench import Bench
from drivers.simulators.settings import settings_from_dict
from fitting.trial import RejectedTrial, Trial, read_alone
from station.bench.bench_clock import BenchClock
from station.bench.trial_recorder import TrialRecorder
from station.config import parse_config
from station.protocol import TrialSpec
from tests.recordings.trials import chunk_starts
from tests.station.command import Ran

STATIC, DYNAMIC = "cuff-waist_test-static_run-1.mcap", "cuff-waist_test-dynamic_run-1.mcap"
SETTINGS = {
    "ports": {"serial": None},
    "operator": {"capture": "remote"},
    "protocol": {
        "static": {"lead_in_s": 2.0, "hold_s": 4.0, "step_masses_kg": [1.5, 1.5]},
        "dynamic": {"swing_s": 12.0},
    },
    "mocap": {"occlusions_per_minute": 0},
}
ADVICE = ("active high", "check the cable", "sync output", "armed before", "warm", "likely:")
"""Of wires and devices, which a damaged file says nothing of."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A static and a dynamic trial, as the station recorded them over its wires."""
    folder = tmp_path_factory.mktemp("recorded")
    with Bench(settings_from_dict(SETTINGS), None, seed=3) as bench, BenchClock(bench.ports["clock"]) as clock:
        config = {
            "daq": {"grpc_target": f"127.0.0.1:{bench.ports['ni']}"},
            "mocap": {"port": bench.ports["qtm"], "control": "start"},
            "sync": {"stop_edge": "end_of_frame"},
            "cuffs": {"waist": {"anchor_markers": bench.world.labels[:4], "cuff_markers": ["cuff_1"]}},
        }
        for test in ("static", "dynamic"):
            bench.world.select_trial("waist", test)  # type: ignore[arg-type]
            spec = TrialSpec("waist", test, 1)  # type: ignore[arg-type]
            assert TrialRecorder(parse_config(config, "test"), clock, []).record(folder, spec).accepted
    return folder


def _flipped(recorded: Path, folder: Path, file: str, byte: int) -> Path:
    session = shutil.copytree(recorded, folder / "session")
    data = bytearray((session / file).read_bytes())
    data[byte] ^= 0x10
    (session / file).write_bytes(data)
    return session


def _assert_only_damage_is_told(ran: Ran, session: Path, file: str) -> None:
    assert ran.code == 3, ran.err
    first = next(line for line in ran.err.splitlines() if not line.startswith(("reading trials", "fitting cuffs")))
    assert first.startswith(f"{file} is damaged: damage at byte"), ran.err
    told = " ".join(line for line in (ran.err + ran.out).splitlines() if file in line)
    assert not [advice for advice in ADVICE if advice in told], told
    fitted = json.loads((session / "cuffs.json").read_text(encoding="utf-8"))
    listed = {each["file"]: each for each in (*fitted["rejected"], *fitted["cuffs"]["waist"]["trials"])}
    assert listed[file]["damage"]
    sentences = [listed[file]["reason"], *listed[file].get("notes", ())]
    assert "the file is damaged (damage at byte" in " ".join(sentences)
    assert not [advice for advice in ADVICE if advice in " ".join(sentences)]


def test_a_sound_session_is_told_of_no_damage(station, recorded: Path, tmp_path: Path) -> None:
    session = shutil.copytree(recorded, tmp_path / "session")
    ran = station("fit", session)
    assert ran.code == 0, ran.err
    assert "damage" not in ran.err + ran.out


@pytest.mark.parametrize("file", [STATIC, DYNAMIC])
def test_one_flipped_bit_at_byte_3000_is_damage_and_no_wiring_fault(
    station, recorded: Path, tmp_path: Path, file: str
) -> None:
    session = _flipped(recorded, tmp_path, file, 3000)
    _assert_only_damage_is_told(station("fit", session), session, file)


def test_a_session_whose_only_recording_is_damaged_beyond_use_ends_with_3_too(
    station, recorded: Path, tmp_path: Path
) -> None:
    session = tmp_path / "session"
    session.mkdir()
    starts = chunk_starts(recorded / STATIC)
    data = bytearray((recorded / STATIC).read_bytes())
    for start in starts[1:]:
        data[start + 200] ^= 0x10
    (session / STATIC).write_bytes(data)
    ran = station("fit", session)
    assert f"station: {STATIC} is damaged, and no recording in" in ran.err
    assert not [advice for advice in ADVICE if advice in ran.err], ran.err
    assert ran.code == 3, ran.err


@pytest.mark.parametrize("part", [0.02, 0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_bit_flipped_anywhere_among_the_samples_is_damage(
    station, recorded: Path, tmp_path: Path, part: float
) -> None:
    starts = chunk_starts(recorded / STATIC)
    chunk = int(part * len(starts))
    session = _flipped(recorded, tmp_path, STATIC, starts[chunk] + 200)
    _assert_only_damage_is_told(station("fit", session), session, STATIC)


def test_a_bit_flipped_anywhere_is_damage_or_changes_nothing(recorded: Path, tmp_path: Path) -> None:
    sound = read_alone(recorded / STATIC)
    assert isinstance(sound, Trial)
    data, path, damaged = (recorded / STATIC).read_bytes(), tmp_path / STATIC, 0
    every = np.random.default_rng(1).integers(0, len(data), 60).tolist()
    for byte in (*range(0, 120, 7), *every, *range(len(data) - 400, len(data), 13)):
        spoilt = bytearray(data)
        spoilt[byte] ^= 1 << byte % 8
        path.write_bytes(spoilt)
        reading = read_alone(path)
        if isinstance(reading, RejectedTrial) or reading.damage:
            assert reading.damage, f"byte {byte}: {reading}"
            damaged += 1
        else:
            np.testing.assert_array_equal(reading.force, sound.force)
            np.testing.assert_array_equal(reading.markers, sound.markers)
            assert reading.notes == sound.notes or not reading.is_whole, "an end that looks like a cut is told, too"
    assert damaged > 50, "most of a file is its samples"


def test_a_damaged_file_that_is_the_only_one_is_named_as_that(station, recorded: Path, tmp_path: Path) -> None:
    session = _flipped(recorded, tmp_path, STATIC, 3000)
    (session / DYNAMIC).unlink()
    ran = station("fit", session)
    assert ran.code == 3
    assert f"{STATIC} is damaged" in ran.err
    assert not [advice for advice in ADVICE if advice in ran.err]


def test_a_recovered_copy_of_a_damaged_file_is_not_diagnosed_either(station, recorded: Path, tmp_path: Path) -> None:
    session = _flipped(recorded, tmp_path, STATIC, 3000)
    assert station("recover", session / STATIC).code == 3
    ran = station("fit", session)
    assert ran.code == 3
    assert "is damaged: /" in ran.err, "it lacks messages that its end counted"
    (rejected,) = json.loads((session / "cuffs.json").read_text(encoding="utf-8"))["rejected"]
    assert rejected["reason"].startswith("the file is damaged (/")
    assert not [advice for advice in ADVICE if advice in rejected["reason"]]


def test_info_of_a_damaged_file_advises_on_no_wires(station, recorded: Path, tmp_path: Path) -> None:
    ran = station("info", _flipped(recorded, tmp_path, STATIC, 3000) / STATIC)
    assert ran.code == 3
    assert "damage at byte" in ran.out
    assert not [advice for advice in ADVICE if advice in ran.out]
