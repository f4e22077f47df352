"""EMG of every format has an even sample rate and, with a unit, volts; its activations fit the trial."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitting.emg.envelopes import LINEAR_ENVELOPE, PUBLISHED, EnvelopeSettings
from fitting.emg.shape import ShapeOutcome
from fitting.wearer.wearer_trial import build_wearer_trial
from recordings.manifest import DataOrigin, EmgAmplifier
from solver.bundled import bundled_model
from solver.time_series_table import read_table, write_table
from station.config import ConfigError
from station.emg.emg_json import EmgTrialEntry, read_emg_document
from station.emg.trials import EmgFileError, extract_emg, read_emg_setup, read_emg_trial
from station.exit_code import DONE, FAILED
from station.messages.emg_messages import EmgCode
from tests.fitting.trial.test_analog_signals import MANIFEST, recorded
from tests.refusals import raises_refusal
from tests.station.command import Ran, Station, assert_refused
from tests.station.emg.measured import levels, write_activations, write_emg, write_setup
from tests.station.foreign import Truth

SETUP = read_emg_setup(None)


def written(folder: Path, text: str, name: str = "trial.csv") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def test_volts_are_of_every_unit_that_is_known_and_a_lost_sample_is_no_number(tmp_path: Path) -> None:
    rows = [f"{i / 1000},{i},{i}" for i in range(2000, 2100) if i != 2050]
    trial = read_emg_trial(written(tmp_path, "time,AD [mV],TS [V]\n" + "\n".join(rows)), SETUP)
    assert (trial.labels, trial.unit, trial.start) == (("AD", "TS"), "V", 2.0)
    assert trial.rate == pytest.approx(1000.0)
    assert np.flatnonzero(np.isnan(trial.values[:, 0])).tolist() == [50]
    np.testing.assert_allclose(trial.values[51], [2.051, 2051.0])
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
    with raises_refusal(code, kind=EmgFileError):
        read_emg_trial(written(tmp_path, text, name), SETUP)


def test_a_recording_has_volts_at_the_electrodes_on_the_markers_clock_alone() -> None:
    """Channel b has a spike of 2 µV behind a gain of 2 at every full second, and ten samples are lost."""
    tracks = recorded()
    kept = np.r_[0:10001, 10011 : len(tracks["/emg"].values)]
    lossy = Truth(MANIFEST, tracks).with_track("/emg", kept)
    wearer = build_wearer_trial(MANIFEST, lossy.tracks, "motion.mcap", "0" * 64)
    trial = extract_emg(wearer)
    spikes = np.flatnonzero(trial.values[:, 1] > 0)
    np.testing.assert_allclose(trial.start + spikes / trial.rate, np.arange(len(spikes)), atol=2e-3)
    assert trial.values[spikes, 1] == pytest.approx(1e-6)
    assert np.isnan(trial.values).sum() == 20
    assert (trial.name, trial.labels, trial.unit, trial.origin) == ("motion", ("a", "b"), "V", DataOrigin.UNKNOWN)
    wearer = build_wearer_trial(replace(MANIFEST, emg=EmgAmplifier("lsl")), recorded(), "motion.mcap", "0" * 64)
    with raises_refusal(EmgCode.NO_EMG, kind=EmgFileError):
        extract_emg(wearer)


# The set-up of EMG: the default fits the bundled model, and a wrong name is refused with similar ones.


def setup_of(folder: Path, text: str):
    return read_emg_setup(write_setup(folder / "emg.toml", text))


def test_the_default_fits_the_code_and_the_model_and_combines_muscles() -> None:
    setup = read_emg_setup(None)
    assert setup.envelope.settings() == LINEAR_ENVELOPE
    assert set(setup.channels) >= {"AD", "MD", "PD", "TS", "TM", "TI", "Infra", "SA", "LatD", "PM_Clav", "TMajor"}
    setup.require_muscles(setup.channels, bundled_model().muscle_names, "the bundled model")
    setup = read_emg_setup(None)
    activations = np.array([[0.1, 0.2, 0.6], [0.3, 0.3, 0.3]])
    serratus = setup.channels["SA"]
    assert serratus.combined(activations) == pytest.approx([0.3, 0.3])
    assert serratus.model_copy(update={"combine": "max"}).combined(activations) == pytest.approx([0.6, 0.3])
    assert serratus.model_copy(update={"weights": (1.0, 0.0, 3.0)}).combined(activations) == pytest.approx([0.475, 0.3])


def test_a_set_up_overrides_the_defaults_and_similar_names_are_suggested(tmp_path: Path) -> None:
    assert setup_of(tmp_path, '[envelope]\nmethod = "seth_2019"\n').envelope.settings() == PUBLISHED
    setup = setup_of(tmp_path, '[envelope]\nmethod = "rms"\nwindow_s = 0.2\n[channels]\nX = { muscles = ["A"] }\n')
    assert setup.envelope.settings() == EnvelopeSettings(smoothing="rms", window_s=0.2)
    assert list(setup.channels) == ["X"]
    setup = read_emg_setup(None)
    with raises_refusal(EmgCode.UNKNOWN_CHANNEL, "LAD", kind=ConfigError, name="AD"):
        setup.require_channels(["LAD", "serratus"], "emg.csv")
    with raises_refusal(EmgCode.UNKNOWN_MUSCLE, "DeltoideusClavicle_B", kind=ConfigError, name="DeltoideusClavicle_A"):
        setup.require_muscles(["AD"], ["TRIlong", "DeltoideusClavicle_B"], "act.sto")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[channels]\nAD = {}\n", "channels.AD.muscles is missing"),
        ("[envelope]\nmethod = 'seth_2019'\nlow_pass_hz = 6.0\n", "low_pass_hz is not used by the method seth_2019"),
        ("[envelope]\nband_hz = [450.0, 20.0]\n", "expected the lower cut-off first"),
        ("[channels]\nAD = { muscles = ['A', 'B'], weights = [1] }\n", "weights need one value for each muscle"),
        ("[channels]\nAD = { muscles = ['A'], combine = 'max', weights = [1] }\n", "combine = 'mean'"),
        ("[chanels]\n", "unknown key chanels"),
        ("[file]\nunit = 'kV'\n", "file.unit is 'kV'"),
    ],
)
def test_a_wrong_set_up_is_refused_with_its_key(tmp_path: Path, text: str, reason: str) -> None:
    with raises_refusal(EmgCode.SETUP_WRONG, reason, kind=ConfigError):
        setup_of(tmp_path, text)


@pytest.fixture
def run(station: Station, tmp_path: Path) -> Callable[[Path], Ran]:
    """Compares a trial of 8 s with a file of activations."""
    write_emg(tmp_path / "lift.csv", levels(), seed=1)
    setup, output = write_setup(tmp_path / "emg.toml"), tmp_path / "results"
    words = ("--setup", setup, "--output", output)
    return lambda activations: station("emg", tmp_path / "lift.csv", "--activations", activations, *words)


def trial(folder: Path) -> EmgTrialEntry:
    (found,) = read_emg_document(folder / "results" / "emg.json").trials
    return found


def as_sto(path: Path, *, start: float = 0.0, end: float = 8.0) -> Path:
    """Frames of the same activations between start and end [s], under OpenSim's header of these."""
    names, table, _ = read_table(write_activations(path.with_suffix(".csv")))
    kept = table[(table[:, 0] >= start) & (table[:, 0] < end)]
    write_table(path, names[1:], kept[:, 0], kept[:, 1:])
    return path


def test_only_a_cut_table_of_activations_is_a_finding(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    """A few frames at both ends are missing where a motion is shorter than its EMG."""
    for ends in ({}, {"start": 0.1, "end": 7.8}):
        ran = run(as_sto(tmp_path / "rmr.sto", **ends))
        assert (ran.code, ran.err, trial(tmp_path).findings) == (DONE, "", [])
    path = as_sto(tmp_path / "rmr.sto")
    lines = path.read_text(encoding="utf-8").splitlines()
    path.write_text("\n".join(lines[:-10]) + "\n", encoding="utf-8")
    ran = run(path)
    (finding,) = trial(tmp_path).findings
    assert (ran.code, finding.code) == (DONE, EmgCode.ROW_COUNTS)
    assert finding.figures == {"file": "rmr.sto", "stated": 800, "found": 790}
    assert str(finding) in ran.err


@pytest.mark.parametrize("shift", [-4.0, 0.5, 5.0])
def test_activations_of_another_start_are_a_finding(run: Callable[[Path], Ran], tmp_path: Path, shift: float) -> None:
    ran = run(write_activations(tmp_path / "rmr.csv", start=shift))
    (finding,) = trial(tmp_path).findings
    assert (ran.code, finding.code) == (DONE, EmgCode.PARTLY_COMMON)
    assert finding.figures["common_s"] == pytest.approx(8 - abs(shift), abs=0.02)
    assert finding.figures["model_start_s"] == pytest.approx(shift)
    assert str(finding) in ran.err
    run(as_sto(tmp_path / "rmr.sto", end=7.5))  # or of a shorter trial
    assert [finding.code for finding in trial(tmp_path).findings] == [EmgCode.PARTLY_COMMON]


def test_activations_of_every_twentieth_frame_are_compared(run: Callable[[Path], Ran], tmp_path: Path) -> None:
    names, table, _ = read_table(write_activations(tmp_path / "rmr.csv"))
    write_table(tmp_path / "ms.csv", names[1:], 1e3 * table[:, 0], table[:, 1:])
    assert_refused(run(tmp_path / "ms.csv"), FAILED, EmgCode.FEW_TIMES)
    write_table(tmp_path / "few.csv", names[1:], table[::20, 0], table[::20, 1:])
    run(tmp_path / "few.csv")
    (first, _), found = trial(tmp_path).channels, trial(tmp_path).findings
    assert first.shape is not None and first.shape.outcome is ShapeOutcome.COMPARED
    assert np.isfinite(first.shape.correlation.value or np.nan) and found == []
