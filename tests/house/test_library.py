"""The public package: its names, what its functions return, and the scripts in examples/ that use it."""

from __future__ import annotations

import ast
import inspect
import runpy
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cuffstation as cs
from fitting.results.codes import NoteCode
from station.fit import SessionError
from station.messages.setup_codes import FolderCode
from tests.station.refusals import raises_refusal

FUNCTIONS = {
    "assess",
    "fit_donning",
    "fit_session",
    "load_model",
    "load_motion",
    "open_stream",
    "plot",
    "read_cuffs",
    "read_recording",
    "solve_motion",
    "with_reserves",
    "write_cuffs",
}
TYPES = {
    "Assessment",
    "CuffFit",
    "Estimate",
    "Kinematics",
    "Model",
    "MotionSolution",
    "ReactionRequest",
    "Recording",
    "RedundancyOptions",
    "Reserve",
    "SessionFit",
    "StreamFrame",
    "StreamSolver",
    "StreamSuitFrame",
    "Track",
    "WearableCuff",
}
ERRORS = {"DeviceError", "FitError", "RecordingError", "SolverError", "StationError"}
EXAMPLES = Path(__file__).parents[2] / "examples"


def test_the_public_names_are_these_and_each_is_documented() -> None:
    assert set(cs.__all__) == FUNCTIONS | TYPES | ERRORS
    for name in cs.__all__:
        assert getattr(cs, name).__doc__, name


def test_a_type_checker_finds_each_name_in_the_module_that_it_is_imported_from() -> None:
    source = Path(cs.__file__)
    imports = [
        node for node in ast.walk(ast.parse(source.read_text(encoding="utf-8"))) if isinstance(node, ast.ImportFrom)
    ]
    declared = {alias.asname: (node.module, alias.name) for node in imports for alias in node.names if alias.asname}
    assert declared == {name: (module, name) for name, module in cs._MODULES.items()}


def test_a_session_becomes_tables_that_agree_with_its_estimates(session: Path, tmp_path: Path) -> None:
    fitted = cs.fit_session(session)
    table = fitted.to_dataframe().set_index("quantity")
    cuff = fitted.cuffs["hand"]
    assert list(table.index) == ["stiffness", "damping", "migration"]
    assert table.loc["stiffness", "value"] == cuff.stiffness.value
    assert tuple(table.loc["damping", ["ci95_low", "ci95_high"]]) == cuff.damping.ci95
    assert table["is_identified"].tolist() == [name not in cuff.missing for name in table.index]

    cs.write_cuffs(tmp_path / "cuffs.json", fitted.cuffs)
    read = cs.read_cuffs(tmp_path / "cuffs.json")["hand"]
    assert (read.stiffness, read.damping, read.migration) == (cuff.stiffness, cuff.damping, cuff.migration)


def test_a_donning_is_that_of_its_session_and_two_cuffs_are_none(session: Path) -> None:
    fitted = cs.fit_session(session)
    whole = fitted.cuffs["hand"]
    alone = cs.fit_donning([path for path in sorted(session.glob("*.mcap")) if "waist" not in path.name])
    assert alone.stiffness == whole.stiffness
    for recordings, reason in (([], "none was given"), ([session / file for file in fitted.bounces], "only bounce")):
        with raises_refusal(SessionError, FolderCode.NO_TRIAL_USABLE) as refused:
            cs.fit_donning(recordings)
        assert reason in str(refused.value)


def test_the_bounces_of_a_session_calibrate_a_donning_that_is_fitted_alone(session: Path) -> None:
    whole = cs.fit_session(session)
    used = [trial.file for trial in whole.cuffs["hand"].trials if trial.state == "used"]
    calibrated = cs.fit_donning([session / file for file in (*whole.bounces, *used)])
    declared = cs.fit_donning([session / file for file in used])
    assert (calibrated.stiffness, calibrated.damping) == (whole.cuffs["hand"].stiffness, whole.cuffs["hand"].damping)
    assert declared.damping != calibrated.damping
    for fit, is_said in ((whole.cuffs["hand"], False), (calibrated, False), (declared, True)):
        assert (NoteCode.NOT_CALIBRATED in [note.code for note in fit.notes]) == is_said
        assert (NoteCode.NOT_CALIBRATED in repr(fit)) == is_said


def test_a_recording_becomes_tables_of_its_samples(session: Path) -> None:
    recording = cs.read_recording(next(session.glob("*static*.mcap")))
    force, markers = (recording.load(name) for name in ("/force", "/markers"))
    table = markers.to_dataframe()
    label = markers.stream.labels[1]
    np.testing.assert_array_equal(table[f"{label}_z"], markers.values[:, 1, 2])
    assert list(force.to_dataframe().columns)[:3] == ["sample_number", "device_time_ns", "host_time_ns"]
    np.testing.assert_array_equal(force.to_dataframe().iloc[:, 3], force.values[:, 0])


def test_every_result_prints_a_few_lines_and_is_drawn(session: Path, tmp_path: Path) -> None:
    fitted, model = cs.fit_session(session), cs.load_model()
    motion = cs.load_motion(model, every=40)
    solution = cs.solve_motion(model, motion)
    assessment = cs.assess(fitted.cuffs, model, motion, draws=0)
    recording = cs.read_recording(next(session.glob("*static*.mcap")))
    for result in (fitted, fitted.cuffs["hand"], solution, assessment, recording):
        assert 1 <= len(repr(result).splitlines()) <= 12
        cs.plot(result).savefig(tmp_path / "plot.png")
        assert (tmp_path / "plot.png").stat().st_size > 5000
    assert max(len(repr(each)) for each in (model, motion, recording.load("/force"))) < 200
    assert isinstance(solution.to_dataframe(), pd.DataFrame)
    assert solution.to_dataframe()[solution.muscles[3]].tolist() == solution.activations[:, 3].tolist()
    for (_, row), curve in zip(assessment.to_dataframe().iterrows(), assessment.curves, strict=True):
        best, step = int(np.nanargmin(curve.cost)), np.diff(assessment.rest_lengths).max()
        assert row["least_effort"] == pytest.approx(curve.cost[best], abs=2e-3)
        assert row["least_effort"] < curve.cost[best] + 1e-12, "the curve is lowest between the lengths tried"
        assert row["rest_length_m"] == pytest.approx(assessment.rest_lengths[best], abs=step)
        assert (row["rest_length_m"], row["effort_at_reference"]) == (
            curve.figures["rest_length"].value,
            curve.figures["at_reference"].value,
        )


def test_what_no_result_is_is_not_drawn() -> None:
    for other in ("demo", {}, {"hand": 1}):
        with pytest.raises(TypeError, match="plot draws"):
            cs.plot(other)


def test_cuffs_by_name_are_drawn_as_their_session(session: Path) -> None:
    fitted = cs.fit_session(session)
    drawn, whole = ([len(axis.lines) for axis in cs.plot(each).axes] for each in (fitted.cuffs, fitted))
    assert drawn == whole
    assert min(drawn) > 2


def test_only_the_public_names_are_listed_and_no_signature_has_a_path_of_this_machine() -> None:
    assert set(dir(cs)) == {*cs.__all__, "__version__"}
    for name in FUNCTIONS:
        assert "PosixPath" not in str(inspect.signature(getattr(cs, name)))


def test_arguments_that_are_exchanged_or_of_another_type_are_named(session: Path, tmp_path: Path) -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, every=200)
    fitted = cs.fit_session(session)
    file = str(tmp_path / "cuffs.json")
    cs.write_cuffs(file, fitted.cuffs)
    for argument, found, ask in (
        ("recordings", "str", lambda: cs.fit_donning(str(session / "a.mcap"))),
        ("recordings", "Model", lambda: cs.fit_donning(model)),
        ("cuffs", "SessionFit", lambda: cs.write_cuffs(file, fitted)),
        ("cuffs", "str", lambda: cs.write_cuffs(fitted.cuffs, file)),
        ("cuffs", "WearableCuff", lambda: cs.write_cuffs(file, cs.read_cuffs(file))),
        ("model", "str", lambda: cs.load_motion("lift.mot")),
        ("model", "Kinematics", lambda: cs.solve_motion(motion, model)),
        ("kinematics", "str", lambda: cs.solve_motion(model, "lift.mot")),
        ("kinematics", "str", lambda: cs.assess({}, model, "lift.mot")),
        ("model", "Kinematics", lambda: cs.assess({}, motion)),
        ("markers", "Model", lambda: cs.open_stream(model)),
        ("markers", "str", lambda: cs.open_stream("ts")),
        ("model", "str", lambda: cs.open_stream(["ts"], "arm.osim")),
        ("rest_lengths", "str", lambda: cs.open_stream(["ts"], model, {"worn": "0.7"})),
        ("cuffs", "int", lambda: cs.assess({"hand": 3})),
        ("options", "int", lambda: cs.assess({}, model, motion, options=3)),
        ("options", "int", lambda: cs.solve_motion(model, motion, 3)),
        ("cutoff_hz", "str", lambda: cs.load_motion(model, None, "3")),
        ("model", "int", lambda: cs.with_reserves(3, {})),
        ("reserves", "NoneType", lambda: cs.with_reserves(model, None)),
        ("reserves", "float", lambda: cs.with_reserves(model, {"shoulder_elv": 5.0})),
    ):
        with pytest.raises(TypeError, match=f"^{argument} should be .* a {found}"):
            ask()


def test_the_error_of_cuffs_that_cannot_be_written_names_their_path(session: Path, tmp_path: Path) -> None:
    path = tmp_path / "missing" / "cuffs.json"
    with pytest.raises(FileNotFoundError) as refused:
        cs.write_cuffs(path, cs.fit_session(session).cuffs)
    assert refused.value.filename == str(path)


@pytest.mark.parametrize("name", ["look_at_a_recording", "fit_a_cuff"])
def test_an_example_without_a_recording_says_how_to_make_one(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [f"{name}.py"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
    assert "`station demo`" in str(ended.value.code)


@pytest.mark.parametrize("name", sorted(path.stem for path in EXAMPLES.glob("*.py")))
def test_the_example_runs_and_is_short(
    name: str, session: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = EXAMPLES / f"{name}.py"
    assert len(path.read_text(encoding="utf-8").splitlines()) < 60
    monkeypatch.chdir(tmp_path)
    needs_session = "SESSION" in path.read_text(encoding="utf-8")
    monkeypatch.setattr(sys, "argv", [str(path), *([str(session)] if needs_session else [])])
    runpy.run_path(str(path), run_name="__main__")
    assert list(tmp_path.glob("*.png"))
