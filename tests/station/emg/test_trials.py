"""EMG of every format has an even sample rate, in volts if the file or the set-up has a unit."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.wearer.wearer_trial import build_wearer_trial
from recordings.manifest import DataOrigin, EmgAmplifier
from station.emg.trials import EmgFileError, emg_of, read_emg_setup, read_emg_trial
from station.messages.emg_codes import EmgCode
from tests.fitting.trial.test_analog_signals import MANIFEST, recorded
from tests.station.refusals import raises_refusal

SETUP = read_emg_setup(None)


def written(folder: Path, text: str, name: str = "trial.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_volts_are_of_every_unit_and_a_lost_sample_is_no_number(tmp_path: Path) -> None:
    rows = [f"{i / 1000},{i},{i}" for i in range(2000, 2100) if i != 2050]
    trial = read_emg_trial(written(tmp_path, "time,AD [mV],TS [V]\n" + "\n".join(rows)), SETUP)
    assert (trial.labels, trial.unit, trial.start) == (("AD", "TS"), "V", 2.0)
    assert trial.rate == pytest.approx(1000.0)
    assert np.flatnonzero(np.isnan(trial.values[:, 0])).tolist() == [50]
    np.testing.assert_allclose(trial.values[51], [2.051, 2051.0])


def test_a_missing_unit_is_unknown_unless_the_set_up_has_one(tmp_path: Path) -> None:
    path = written(tmp_path, "time,AD\n0,5\n0.001,6\n")
    assert read_emg_trial(path, SETUP).unit == ""
    in_microvolts = SETUP.model_copy(update={"file": SETUP.file.model_copy(update={"unit": "uV"})})
    trial = read_emg_trial(path, in_microvolts)
    assert (trial.unit, trial.values[:, 0].tolist()) == ("V", pytest.approx([5e-6, 6e-6]))


@pytest.mark.parametrize(
    ("name", "text", "code"),
    [
        ("a.csv", "time,AD [V],TS\n0,1,2\n0.001,1,2\n", EmgCode.CHANNEL_UNITS),
        ("a.xlsx", "", EmgCode.FILE_FORMAT),
        (
            "a.csv",
            "time,AD\n" + "".join(f"{i / 1000},1\n" for i in [*range(300), *range(5000, 5300)]),
            EmgCode.SAMPLES_MISSING,
        ),
    ],
)
def test_a_file_without_sampled_emg_is_refused(tmp_path: Path, name: str, text: str, code: EmgCode) -> None:
    with raises_refusal(EmgFileError, code):
        read_emg_trial(written(tmp_path, text, name), SETUP)


def test_a_recording_has_volts_at_the_electrodes_from_the_sync_edge_on() -> None:
    """Channel b has a spike of 2 µV behind a gain of 2 at every full second, and ten samples are lost."""
    tracks = recorded()
    kept = np.r_[0:10001, 10011 : len(tracks["/emg"].values)]
    emg = tracks["/emg"]
    arrays = {name: getattr(emg, name)[kept] for name in ("sample_numbers", "device_time_ns", "host_time_ns", "values")}
    wearer = build_wearer_trial(MANIFEST, tracks | {"/emg": replace(emg, **arrays)}, "motion.mcap", "0" * 64)
    trial = emg_of(wearer)
    spikes = np.flatnonzero(trial.values[:, 1] > 0)
    np.testing.assert_allclose(trial.start + spikes / trial.rate, np.arange(len(spikes)), atol=2e-3)
    assert trial.values[spikes, 1] == pytest.approx(1e-6)
    assert np.isnan(trial.values).sum() == 20
    assert (trial.name, trial.labels, trial.unit, trial.origin) == ("motion", ("a", "b"), "V", DataOrigin.UNKNOWN)


def test_a_recording_without_emg_on_the_markers_clock_is_refused_with_the_reason() -> None:
    wearer = build_wearer_trial(replace(MANIFEST, emg=EmgAmplifier("lsl")), recorded(), "motion.mcap", "0" * 64)
    with raises_refusal(EmgFileError, EmgCode.NO_EMG):
        emg_of(wearer)
