"""station emg, on the command line and on public data: envelopes, shapes, change and report."""

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from fitting.emg.channels import ChannelFinding
from fitting.emg.shape import ShapeOutcome
from fitting.results.codes import FitErrorCode
from solver.time_series_table import read_table
from station.assessment.assessment_inputs import read_emg
from station.emg.comparison import ConditionFiles, compare_emg
from station.emg.emg_json import EmgDocument, read_emg_document
from station.emg.trials import EmgFileError
from station.exit_code import DONE, LOSSY, WRONG_USAGE
from station.messages.assessment_messages import InputCode
from station.messages.emg_messages import EmgCode
from tests.conftest import SHARED
from tests.refusals import raises_refusal
from tests.station.command import Ran, Station, assert_one_sentence, assert_refused
from tests.station.emg.measured import levels, write_activations, write_emg, write_mvc, write_setup
from tests.station.reported import unmarked_numbers

PUBLISHED_MAXIMA = {"MD": 0.706, "SA": 1.862}
"""By which the authors divide their EMG, in its unknown unit."""
SETUP = '[envelope]\nmethod = "seth_2019"\n[channels]\n' + "".join(
    f"{label} = {{ muscles = {muscles}, maximum = {PUBLISHED_MAXIMA[label]} }}\n"
    for label, muscles in (
        ("MD", ["DeltoideusScapula_M"]),
        ("SA", ["SerratusAnterior_I", "SerratusAnterior_M", "SerratusAnterior_S"]),
    )
)


@pytest.fixture(scope="module")
def lab(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three repeats in the suit, and three without it with 1.5 times the activation."""
    folder = tmp_path_factory.mktemp("emg")
    for i, spread in enumerate((0.95, 1.0, 1.05)):
        write_emg(folder / f"suit{i}.csv", levels(spread), seed=i)
        write_emg(folder / f"bare{i}.csv", levels(1.5 * spread), seed=10 + i)
    write_activations(folder / "suit.csv.act.csv")
    write_activations(folder / "bare.csv.act.csv", scale=1.25)
    write_mvc(folder / "mvc.csv")
    write_setup(folder / "emg.toml")
    return folder


def arguments(lab: Path, output: Path, *, repeats: int = 3, mvc: bool = True) -> list[object]:
    words: list[object] = [lab / f"suit{i}.csv" for i in range(repeats)]
    for i in range(repeats):
        words += ["--activations", lab / "suit.csv.act.csv", "--reference", lab / f"bare{i}.csv"]
        words += ["--reference-activations", lab / "bare.csv.act.csv"]
    return [*words, *(["--mvc", lab / "mvc.csv"] if mvc else []), "--setup", lab / "emg.toml", "--output", output]


def run(station: Station, lab: Path, output: Path, **options: object) -> tuple[Ran, EmgDocument]:
    ran = station("emg", *arguments(lab, output, **options))  # type: ignore[arg-type]
    assert ran.code == 0, ran.err
    return ran, read_emg_document(output / "emg.json")


def compare(station: Station, recording: Path, lab: Path, output: Path, setup: Path | None = None) -> Ran:
    """One trial with the model's activations in the suit."""
    words = ("--activations", lab / "suit.csv.act.csv", "--setup", setup or lab / "emg.toml", "--output", output)
    return station("emg", recording, *words)


def test_shape_level_and_change_are_those_that_were_simulated(station: Station, lab: Path, tmp_path: Path) -> None:
    ran, document = run(station, lab, tmp_path)
    trials = [trial for trial in document.trials if trial.condition == "condition"]
    for channel in (channel for trial in trials for channel in trial.channels):
        assert channel.shape.outcome is ShapeOutcome.COMPARED
        low, high = channel.shape.lag_s.ci95 or (1, -1)
        assert low <= 0.05 <= high
        assert (channel.shape.correlation.value or 0) > 0.95
    truth = levels().mean(axis=0)  # of full activation; the largest half second of an MVC is above its mean
    assert [channel.mean for channel in trials[1].channels] == pytest.approx(list(truth), rel=0.15)
    assert document.level_unit == "1"
    for change in document.changes:
        low, high = change.emg_ratio.ci95 or (1, 0)
        assert low <= 1 / 1.5 <= high
        assert change.model_ratio.value == pytest.approx(0.8)
        assert (change.repeats, change.repeat_units) == ([3, 3], ["trial", "trial"])
    for pooled in document.pooled:
        low, high = pooled.lag_s.ci95 or (1, -1)
        assert (pooled.trials, pooled.trials_of_lag) == (3, 3)
        assert low <= 0.05 <= high
    assert [(pooled.condition, pooled.channel) for pooled in document.pooled] == [
        (condition, channel) for condition in ("condition", "reference") for channel in ("delt_ant", "serratus")
    ]
    assert "suit0" in ran.out


def test_envelopes_and_change_reach_the_next_stage_and_the_report(station: Station, lab: Path, tmp_path: Path) -> None:
    ran, _ = run(station, lab, tmp_path)
    names, table, _ = read_table(tmp_path / "suit1_emg.sto")
    assert names == ["time", "delt_ant", "serratus"]
    np.testing.assert_allclose(np.diff(table[:, 0]), 0.01, rtol=1e-6)
    assert 0.3 < table[:, 1].max() < 0.5
    assert "unit=fraction of the MVC" in (tmp_path / "suit1_emg.sto").read_text()
    muscles = ["DeltoideusClavicle_A", "SerratusAnterior_I", "SerratusAnterior_M"]
    measured = read_emg(tmp_path / "emg_change.csv", muscles)
    assert [row.muscle for row in measured] == muscles
    assert measured[0].reduction_percent.value == pytest.approx(100 / 3, abs=8)
    assert ran.out.count("_emg.sto") == 6
    assert station("report", tmp_path).code == 0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count('<a id="emg">') == 1
    assert page.count("<figcaption>") == 7  # six trials and the change
    names = (f"{name}{i}" for name in ("suit", "bare") for i in range(3))
    assert unmarked_numbers(tmp_path / "report.html", tmp_path.name, *names) == []
    assert "emg.json" in json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))["inputs"]


def test_without_an_mvc_levels_are_volts_and_one_repeat_is_open(station: Station, lab: Path, tmp_path: Path) -> None:
    """Volts, in the file as in the table; shapes, lags and ratios stay what they are."""
    _, document = run(station, lab, tmp_path, repeats=1, mvc=False)
    assert document.level_unit == "V"
    assert "unit=V" in (tmp_path / "suit0_emg.sto").read_text()
    assert (document.trials[0].channels[0].mean or 0) < 1e-3
    assert [change.emg_ratio.ci95 for change in document.changes] == [None, None]
    assert not (tmp_path / "emg_change.csv").exists()


def test_a_clipped_channel_is_left_out_by_name(station: Station, lab: Path, tmp_path: Path) -> None:
    lines = (lab / "suit0.csv").read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    clipped = [f"{time},{min(float(first), 0.2)},{second}" for time, first, second in rows]
    (tmp_path / "suit0.csv").write_text("\n".join([lines[0], *clipped]))
    ran = compare(station, tmp_path / "suit0.csv", lab, tmp_path)
    assert ran.code == 3
    first, second = read_emg_document(tmp_path / "emg.json").trials[0].channels
    assert (first.findings, first.mean, first.shape) == ([ChannelFinding.CLIPPED], None, None)
    assert second.shape is not None
    assert read_table(tmp_path / "suit0_emg.sto")[0] == ["time", "serratus"]


def test_a_channel_without_mvc_has_a_shape_and_no_level(station: Station, lab: Path, tmp_path: Path) -> None:
    text = (lab / "emg.toml").read_text().replace('_A"]', '_A"], maximum = 4e-4')
    ran = compare(station, lab / "suit1.csv", lab, tmp_path, write_setup(tmp_path / "emg.toml", text))
    first, second = read_emg_document(tmp_path / "emg.json").trials[0].channels
    assert (ran.code, second.findings, second.mean) == (0, [ChannelFinding.NO_MVC], None)
    assert second.shape is not None
    assert first.mean == pytest.approx(levels()[:, 0].mean(), rel=0.1)  # 0.4 mV is the mean of |EMG| at 0.5 mV
    assert read_table(tmp_path / "suit1_emg.sto")[0] == ["time", "delt_ant"]


@pytest.mark.parametrize("names", [("delt_ant", "serratus"), ("AD", "TS")], ids=["set-up", "default map"])
@pytest.mark.parametrize("unit", ["g", "deg/s"])
def test_channels_in_other_units_are_left_out(
    station: Station, tmp_path: Path, names: tuple[str, str], unit: str
) -> None:
    path = write_emg(tmp_path / "lift.csv", levels(), seed=1, titles=(f"{names[0]} [mV]", f"{names[1]} [{unit}]"))
    setup = ["--setup", write_setup(tmp_path / "emg.toml")] if names[0] == "delt_ant" else []
    ran = station("emg", path, *setup, "--output", tmp_path)
    (trial,) = read_emg_document(tmp_path / "emg.json").trials
    (finding,) = trial.findings
    assert (ran.code, finding.code) == (LOSSY, EmgCode.UNREAD_CHANNELS)
    assert finding.figures == {"channels": names[1]}
    assert str(finding) in ran.err
    assert [channel.channel for channel in trial.channels] == [names[0]]


def test_an_acceleration_that_the_set_up_does_not_map_needs_no_finding(station: Station, tmp_path: Path) -> None:
    path = write_emg(tmp_path / "lift.csv", levels(), seed=1, titles=("AD [mV]", "ACC X [g]"))
    assert station("emg", path, "--output", tmp_path).code == DONE
    assert read_emg_document(tmp_path / "emg.json").trials[0].findings == []


SUIT = "--activations suit.csv.act.csv"


@pytest.mark.parametrize(
    ("words", "exit_code", "code"),
    [
        (f"suit0.csv {SUIT} --activations bare.csv.act.csv", 2, EmgCode.ACTIVATIONS_COUNT),
        ("suit0.csv --setup near.toml", 2, EmgCode.UNKNOWN_CHANNEL),
        (f"suit0.csv --setup far.toml {SUIT}", 2, EmgCode.UNKNOWN_MUSCLE),
        (f"suit0.csv {SUIT}", 2, EmgCode.NO_COMMON_CHANNEL),
        ("suit0.csv suit0.csv", 2, EmgCode.SAME_NAME),
        ("slow.csv", 1, FitErrorCode.EMG_RATE),
        ("flat.csv", 1, FitErrorCode.EMG_NO_CHANNEL),
        ("suit0.csv --mvc unknown.csv", 2, EmgCode.MIXED_UNITS),
        ("suit0.csv --setup emg.toml --activations late.csv", 1, FitErrorCode.EMG_OTHER_TIME),
        ("none.csv", 1, ""),
    ],
)
def test_bad_input_is_refused_and_nothing_is_written(
    station: Station, lab: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: str, exit_code: int, code: str
) -> None:
    monkeypatch.chdir(lab)
    write_setup(lab / "near.toml", '[channels]\ndelt_anterior = { muscles = ["DeltoideusClavicle_A"] }\n')
    write_setup(lab / "far.toml", '[channels]\nserratus = { muscles = ["SerratusAnterior_S"] }\n')
    slow = "".join(f"{i / 200},{np.sin(i)}\n" for i in range(400))
    (lab / "slow.csv").write_text("time,AD [V]\n" + slow)
    (lab / "flat.csv").write_text("time,AD [V]\n" + "".join(f"{i / 1000},0.5\n" for i in range(1000)))
    write_emg(lab / "unknown.csv", levels(), seed=5, titles=("delt_ant", "serratus"))
    write_activations(lab / "late.csv", start=100.0)
    ran = station("emg", *words.split(), "--output", tmp_path / "out")
    assert_one_sentence(ran, exit_code)
    assert ran.error == code
    assert not (tmp_path / "out").exists()


def test_a_malformed_emg_json_is_refused_with_its_key(station: Station, lab: Path, tmp_path: Path) -> None:
    run(station, lab, tmp_path, repeats=1)
    path = tmp_path / "emg.json"
    text = path.read_text().replace('"findings": []', '"findings": ["hum"]', 1)
    for before, after, key in (
        ('"format": 1', '"format": 2', "format"),
        ('"time_s": [', '"time_s": [0.0,', "time_s"),
        ('"hum"', '"noisy"', "trials.0.channels.0.findings.0"),
        ("{", "", "JSON"),
    ):
        path.write_text(text.replace(before, after, 1))
        with raises_refusal(EmgCode.WRONG_DOCUMENT, kind=EmgFileError) as caught:
            read_emg_document(path)
        assert key in caught.value.cause.figures["reason"]
        assert station("report", tmp_path).code == 1


def test_a_channel_s_name_of_any_kind_reaches_table_and_figure(station: Station, lab: Path, tmp_path: Path) -> None:
    write_emg(tmp_path / "odd.csv", levels(), seed=3, titles=('"M, left $x_{$ [mV]"', '"M; left $x_{$ [mV]"'))
    setup = write_setup(tmp_path / "emg.toml", "[channels]\n'M, left $x_{$' = { muscles = ['BIC_long'] }\n")
    ran = compare(station, tmp_path / "odd.csv", lab, tmp_path / "out", setup)
    assert ran.code == 0, ran.err
    assert read_table(tmp_path / "out" / "odd_emg.sto")[0] == ["time", "M_left_$x_{$", "M_left_$x_{$_2"]
    assert station("report", tmp_path / "out").code == 0


# station emg writes next to its inputs and overwrites none of them.


@pytest.fixture
def lab_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A trial, and files with the names of its results, in the working directory."""
    monkeypatch.chdir(tmp_path)
    write_emg(tmp_path / "lift.csv", levels(), seed=1)
    write_setup(tmp_path / "emg.toml")
    return tmp_path


def write_louder(path: Path) -> None:
    write_emg(path, levels(1.5), seed=2)


def files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("option", ["", "--reference", "--mvc", "--activations", "--setup"])
def test_an_envelope_does_not_replace_a_file_that_is_read(station: Station, lab_folder: Path, option: str) -> None:
    read = lab_folder / "lift_emg.csv"
    {"--activations": write_activations, "--setup": write_setup, "--mvc": write_mvc}.get(option, write_louder)(read)
    before = files(lab_folder)
    words = ["lift.csv", *filter(None, [option]), read, *(["--setup", "emg.toml"] if option != "--setup" else [])]
    ran = station("emg", *words, "--to", "csv", "--output", ".")
    assert ran.code == WRONG_USAGE and read.name in " ".join(ran.err.split())
    assert files(lab_folder) == before


def test_results_of_an_earlier_run_are_replaced_and_activations_are_not(station: Station, lab_folder: Path) -> None:
    for _ in range(2):
        assert station("emg", "lift.csv", "--output", ".").code == DONE
    write_activations(lab_folder / "emg_change.csv")
    before = files(lab_folder)
    words = ("--activations", "emg_change.csv", "--setup", "emg.toml", "--output", lab_folder)
    assert station("emg", "lift.csv", *words).code == WRONG_USAGE
    assert files(lab_folder) == before


@pytest.mark.parametrize("output", ["emg.toml", "emg.toml/results"])
def test_an_output_that_is_a_file_or_within_one_is_wrong_usage(station: Station, lab_folder: Path, output: str) -> None:
    before = files(lab_folder)
    assert_refused(station("emg", "lift.csv", "--output", output), WRONG_USAGE, InputCode.OUTPUT_IS_FILE)
    assert files(lab_folder) == before


@pytest.mark.shared
def test_level_and_correlation_are_those_of_the_published_processing(tmp_path: Path) -> None:
    """Divided by the maximum, high-pass forwards, rectified, low-pass forwards and backwards; then Pearson's r."""
    path, setup = tmp_path / "FLX01.exp", tmp_path / "emg.toml"
    path.write_bytes(gzip.decompress((SHARED / "markers" / "FLX01_emg.exp.gz").read_bytes()))
    setup.write_text(SETUP, encoding="utf-8")
    activations = SHARED / "published" / "FLX01_gh.csv"
    compared = compare_emg(ConditionFiles((path,), (activations,)), ConditionFiles(()), (), setup).trials[0]

    raw, model = np.genfromtxt(path, skip_header=9), np.genfromtxt(activations, delimiter=",", names=True)
    columns = {"MD": (2, ["DeltoideusScapula_M"]), "SA": (8, [f"SerratusAnterior_{part}" for part in "IMS"])}
    for label, (column, muscles) in columns.items():
        high = signal.lfilter(*signal.butter(4, 100 / 500, "high"), raw[:, column] / PUBLISHED_MAXIMA[label])
        envelope = signal.filtfilt(*signal.butter(2, 2.5 / 500), np.abs(high), padlen=6)
        np.testing.assert_allclose(compared.levels.of(label), np.maximum(envelope, 0), rtol=1e-7, atol=1e-12)
        inner = slice(50, -50)
        activation = np.mean([model[muscle] for muscle in muscles], axis=0)
        r = np.corrcoef(np.interp(model["time"], raw[:, 0] / 1000, envelope)[inner], activation[inner])[0, 1]
        found = compared.comparisons[label]
        assert found.outcome is ShapeOutcome.LAG_NOT_IDENTIFIED
        assert found.correlation == pytest.approx(r, abs=0.02)  # ours smooths the model, too, and at fewer samples
        assert found.correlation_ci95[0] < r < found.correlation_ci95[1]
    assert compared.levels.of("MD").max() == pytest.approx(0.43, abs=0.01)
    assert compared.envelopes.findings["Infra"] == (ChannelFinding.HUM,)
    assert ChannelFinding.NO_MVC in compared.levels.findings["AD"]
