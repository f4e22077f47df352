"""Flipped bits in a stored recording: the fit reports the damage first, without other diagnoses, and exits with 3."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from drivers.simulators.settings import settings_from_dict
from drivers.simulators.simulated_bench import Bench
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.trial import RejectedTrial, Trial, read_alone
from station.bench.bench_clock import BenchClock
from station.bench.trial_recorder import TrialRecorder
from station.messages.setup_messages import FolderCode
from station.protocol import TrialSpec
from tests.recordings.trials import chunk_starts
from tests.station.command import Ran
from tests.station.session.benched import config_at

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
"""Words of advice on wires and devices, of which a damaged file is no evidence."""


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A static and a dynamic trial, recorded from simulated devices."""
    folder = tmp_path_factory.mktemp("recorded")
    with Bench(settings_from_dict(SETTINGS), None, seed=3) as bench, BenchClock(bench.ports["clock"]) as clock:
        config = config_at(bench.ports, mocap={"control": "start"}, sync={"stop_edge": "end_of_frame"})
        for test in ("static", "dynamic"):
            bench.world.select_trial("waist", test)  # type: ignore[arg-type]
            spec = TrialSpec("waist", test, 1)  # type: ignore[arg-type]
            assert TrialRecorder(config, clock, []).record(folder, spec).accepted
    return folder


def _flipped(recorded: Path, folder: Path, file: str, *bytes_: int) -> Path:
    session = shutil.copytree(recorded, folder / "session")
    data = bytearray((session / file).read_bytes())
    for byte in bytes_:
        data[byte] ^= 0x10
    (session / file).write_bytes(data)
    return session


def _assert_only_damage_is_reported(ran: Ran, session: Path, file: str) -> None:
    assert ran.code == 3, ran.err
    first = next(line for line in ran.err.splitlines() if not line.startswith(("reading trials", "fitting cuffs")))
    assert first.startswith(file), ran.err
    lines = " ".join(line for line in (ran.err + ran.out).splitlines() if file in line)
    assert not [advice for advice in ADVICE if advice in lines], lines
    fitted = json.loads((session / "cuffs.json").read_text(encoding="utf-8"))
    by_file = {entry["file"]: entry for entry in (*fitted["rejected"], *fitted["cuffs"]["waist"]["trials"])}
    entry = by_file[file]
    assert entry["damage"]
    reason = [entry["reason_code"]] if entry["reason_code"] else []
    codes = {code["code"] for code in (*reason, *entry.get("note_codes", ()))}
    assert codes <= {RejectionCode.DAMAGED, TrialNoteCode.DAMAGED} and codes


def test_an_intact_session_has_no_damage(station, recorded: Path, tmp_path: Path) -> None:
    session = shutil.copytree(recorded, tmp_path / "session")
    ran = station("fit", session)
    assert ran.code == 0, ran.err
    assert "damage" not in ran.err + ran.out


def test_a_session_whose_only_recording_is_unusable_through_damage_exits_with_3(
    station, recorded: Path, tmp_path: Path
) -> None:
    session = _flipped(recorded, tmp_path, STATIC, *(start + 200 for start in chunk_starts(recorded / STATIC)[1:]))
    (session / DYNAMIC).unlink()
    ran = station("fit", session)
    assert ran.error == FolderCode.DAMAGED and STATIC in ran.err
    assert not [advice for advice in ADVICE if advice in ran.err], ran.err
    assert ran.code == 3, ran.err


@pytest.mark.parametrize(("file", "part"), [(DYNAMIC, 0), (STATIC, 0), (STATIC, 0.1), (STATIC, 0.5), (STATIC, 0.9)])
def test_a_flipped_bit_is_damage_and_not_a_wiring_fault(
    station, recorded: Path, tmp_path: Path, file: str, part: float
) -> None:
    """In the part of the samples, or before the first one."""
    starts = chunk_starts(recorded / file)
    session = _flipped(recorded, tmp_path, file, starts[int(part * len(starts))] + 200 if part else 3000)
    _assert_only_damage_is_reported(station("fit", session), session, file)


def test_a_bit_flipped_anywhere_is_damage_or_changes_nothing(recorded: Path, tmp_path: Path) -> None:
    intact = read_alone(recorded / STATIC)
    assert isinstance(intact, Trial)
    data, path, damaged = (recorded / STATIC).read_bytes(), tmp_path / STATIC, 0
    positions = np.random.default_rng(1).integers(0, len(data), 60).tolist()
    for byte in (*range(0, 120, 7), *positions, *range(len(data) - 400, len(data), 13)):
        damaged_data = bytearray(data)
        damaged_data[byte] ^= 1 << byte % 8
        path.write_bytes(damaged_data)
        reading = read_alone(path)
        if isinstance(reading, RejectedTrial) or reading.damage:
            assert reading.damage, f"byte {byte}: {reading}"
            damaged += 1
        else:
            np.testing.assert_array_equal(reading.force, intact.force)
            np.testing.assert_array_equal(reading.markers, intact.markers)
            assert reading.notes == intact.notes or not reading.is_whole, "an end that looks truncated is noted, too"
    assert damaged > 50, "most of a file is its samples"


def test_a_recovered_copy_of_a_damaged_file_is_not_diagnosed_either(station, recorded: Path, tmp_path: Path) -> None:
    session = _flipped(recorded, tmp_path, STATIC, 3000)
    assert station("recover", session / STATIC).code == 3
    ran = station("fit", session)
    assert ran.code == 3
    (rejected,) = json.loads((session / "cuffs.json").read_text(encoding="utf-8"))["rejected"]
    assert rejected["damage"] and rejected["reason_code"]["code"] == RejectionCode.DAMAGED
    assert not [advice for advice in ADVICE if advice in rejected["reason"]]


def test_an_export_of_a_damaged_or_cut_file_says_what_is_missing(station, recorded: Path, tmp_path: Path) -> None:
    starts = chunk_starts(recorded / STATIC)
    damaged = _flipped(recorded, tmp_path, STATIC, starts[len(starts) // 2] + 200) / STATIC
    cut = tmp_path / STATIC
    cut.write_bytes((recorded / STATIC).read_bytes()[: starts[len(starts) * 2 // 3]])
    for path, reason in ((damaged, "crc validation failed"), (cut, "there is no outcome")):
        ran = station("export", path, "--to", "csv", "--output", tmp_path / "out", "--format", "json")
        info = station("info", path)
        assert ran.code == info.code == 3
        assert not [advice for advice in ADVICE if advice in info.out]
        assert "damage" in info.out or path == cut
        notes = json.loads(ran.out)["note_codes"]
        reasons = [note["figures"]["reasons"] for note in notes if "reasons" in note["figures"]]
        assert len(reasons) == 1 and reason in reasons[0]
