"""The public package: its names, and what its functions return."""

import ast
import inspect
import sys
from collections.abc import Mapping
from dataclasses import fields, is_dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

import cuffstation as cs
from documents.interval import plus_minus
from fitting.results.codes import NoteCode
from fitting.results.trial_codes import TrialNoteCode
from fitting.trial.trial import within
from solver.errors import SolverCode
from station.fit import SessionError
from station.messages.setup_messages import FolderCode
from tests.house.sources import ROOT, nodes_of, run_python
from tests.refusals import raises_refusal

PLUGIN = "cuffstation.pytest_plugin"

FUNCTIONS = (
    "assess fit_donning fit_session load_model load_motion open_stream plot published_cuffs read_cuffs read_recording "
    "sample_session solve_motion with_reserves write_cuffs"
)
TYPES = (
    "ActivationCost Assessment Cuff CuffFit Estimate Kinematics Model MotionSolution ReactionRequest Recording "
    "RedundancyOptions Reserve SessionFit StreamFrame StreamSolver StreamSuitFrame Track"
)
ERRORS = "DeviceError FitError RecordingError SolverError StationError"


@pytest.fixture(scope="module")
def fitted(session: Path) -> cs.SessionFit:
    return cs.fit_session(session)


def test_the_public_names_are_documented_and_found_by_a_type_checker() -> None:
    assert set(cs.__all__) == set(f"{FUNCTIONS} {TYPES} {ERRORS}".split())
    assert set(dir(cs)) == {*cs.__all__, "__version__"}
    for name in cs.__all__:
        assert getattr(cs, name).__doc__, name
    for name in FUNCTIONS.split():
        assert "PosixPath" not in str(inspect.signature(getattr(cs, name)))
    imports = (node for node in nodes_of(Path(cs.__file__)) if isinstance(node, ast.ImportFrom))
    declared = {alias.asname: (node.module, alias.name) for node in imports for alias in node.names if alias.asname}
    assert declared == {name: (module, name) for name, module in cs._MODULES.items()}


def test_a_session_becomes_tables_that_agree_with_its_estimates(fitted: cs.SessionFit, tmp_path: Path) -> None:
    table = fitted.to_dataframe().set_index("quantity")
    cuff = fitted.cuffs["hand"]
    assert list(table.index) == ["stiffness", "damping", "migration"]
    assert table.loc["stiffness", "value"] == cuff.stiffness.value
    assert tuple(table.loc["damping", ["ci95_low", "ci95_high"]]) == cuff.damping.ci95
    assert table["is_identified"].tolist() == [name not in cuff.missing for name in table.index]

    cs.write_cuffs(tmp_path / "cuffs.json", fitted.cuffs)
    read = cs.read_cuffs(tmp_path / "cuffs.json")["hand"]
    assert (read.stiffness, read.damping, read.migration) == (cuff.stiffness, cuff.damping, cuff.migration)


def test_a_donning_is_that_of_its_session_and_bounces_calibrate_it(session: Path, fitted: cs.SessionFit) -> None:
    whole = fitted.cuffs["hand"]
    alone = cs.fit_donning([path for path in sorted(session.glob("*.mcap")) if "waist" not in path.name])
    assert alone.stiffness == whole.stiffness
    for recordings, reason in (([], "none was given"), ([session / file for file in fitted.bounces], "only bounce")):
        with raises_refusal(FolderCode.NO_TRIAL_USABLE, reason, kind=SessionError):
            cs.fit_donning(recordings)
    whole = fitted
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


def test_every_result_prints_a_few_lines_and_is_drawn(session: Path, fitted: cs.SessionFit, tmp_path: Path) -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, every=40)
    solution = cs.solve_motion(model, motion)
    assessment = cs.assess(fitted.cuffs, model, motion, people=0)
    recording = cs.read_recording(next(session.glob("*static*.mcap")))
    for result in (fitted, fitted.cuffs["hand"], solution, assessment, recording):
        assert 1 <= len(repr(result).splitlines()) <= 12
        cs.plot(result).savefig(tmp_path / "plot.png")
        assert (tmp_path / "plot.png").stat().st_size > 5000
    assert max(len(repr(each)) for each in (model, motion, recording.load("/force"))) < 200
    static = next(trial for trial in fitted.cuffs["hand"].trials if trial.stiffness)
    assert static.stiffness and f"{static.stiffness.value:.0f} ± {static.stiffness.standard_error:.0f} N/m" in repr(
        static
    )
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


def test_cuffs_by_name_are_drawn_as_their_session_and_what_is_no_result_is_not(fitted: cs.SessionFit) -> None:
    drawn, whole = ([len(axis.lines) for axis in cs.plot(each).axes] for each in (fitted.cuffs, fitted))
    assert drawn == whole
    assert min(drawn) > 2
    for other in ("demo", {}, {"hand": 1}):
        with pytest.raises(TypeError, match="plot draws"):
            cs.plot(other)


def test_arguments_of_another_type_are_named(session: Path, fitted: cs.SessionFit, tmp_path: Path) -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, every=200)
    file = str(tmp_path / "cuffs.json")
    cs.write_cuffs(file, fitted.cuffs)
    for argument, found, ask in (
        ("recordings", "str", lambda: cs.fit_donning(str(session / "a.mcap"))),
        ("recordings", "Model", lambda: cs.fit_donning(model)),
        ("cuffs", "SessionFit", lambda: cs.write_cuffs(file, fitted)),
        ("cuffs", "str", lambda: cs.write_cuffs(fitted.cuffs, file)),
        ("cuffs", "Cuff", lambda: cs.write_cuffs(file, cs.read_cuffs(file))),
        ("model", "str", lambda: cs.load_motion("lift.mot")),
        ("model", "Kinematics", lambda: cs.solve_motion(motion, model)),
        ("kinematics", "str", lambda: cs.solve_motion(model, "lift.mot")),
        ("kinematics", "str", lambda: cs.assess({}, model, "lift.mot")),
        ("model", "Kinematics", lambda: cs.assess({}, motion)),
        ("markers", "Model", lambda: cs.open_stream(model)),
        ("markers", "str", lambda: cs.open_stream("ts")),
        ("model", "str", lambda: cs.open_stream(["ts"], "arm.osim")),
        ("rest_lengths", "str", lambda: cs.open_stream(["ts"], model, {"worn": "0.7"})),
        ("rest_lengths", "str", lambda: cs.assess(fitted, rest_lengths="wide")),
        ("rest_lengths", "list", lambda: cs.assess(fitted, rest_lengths=[0.6, None])),
        ("reference_rest_length", "str", lambda: cs.assess(fitted, reference_rest_length="0.7")),
        ("lag_s", "str", lambda: cs.open_stream(["ts"], model, lag_s="0.1")),
        ("soft_tissue_m", "str", lambda: cs.open_stream(["ts"], model, soft_tissue_m="0.01")),
        ("window", "str", lambda: cs.fit_session(session, window="0.5")),
        ("window", "float", lambda: cs.fit_donning([], window=0.5)),
        ("ax", "str", lambda: cs.plot(fitted, ax="left")),
        ("path", "int", lambda: cs.read_recording(3)),
        ("path", "NoneType", lambda: cs.read_cuffs(None)),
        ("path", "int", lambda: cs.write_cuffs(3, fitted.cuffs)),
        ("path", "list", lambda: cs.load_motion(model, [0.0, 1.0])),
        ("folder", "NoneType", lambda: cs.fit_session(None)),
        ("recordings", "int", lambda: cs.fit_donning([3])),
        ("source", "int", lambda: cs.load_model(3)),
        ("suit", "int", lambda: cs.assess(fitted, model, motion, suit=3)),
        ("external_loads", "int", lambda: cs.solve_motion(model, motion, external_loads=3)),
        ("cuffs", "int", lambda: cs.assess({"hand": 3})),
        ("cuffs", "int", lambda: cs.assess(3)),
        ("options", "int", lambda: cs.assess({}, model, motion, options=3)),
        ("options", "int", lambda: cs.solve_motion(model, motion, 3)),
        ("cutoff_hz", "str", lambda: cs.load_motion(model, None, "3")),
        ("model", "int", lambda: cs.with_reserves(3, {})),
        ("reserves", "NoneType", lambda: cs.with_reserves(model, None)),
        ("reserves", "float", lambda: cs.with_reserves(model, {"shoulder_elv": 5.0})),
    ):
        with pytest.raises(TypeError, match=f"^{argument} should be .* a {found}"):
            ask()


def test_the_error_of_cuffs_that_cannot_be_written_names_their_path(fitted: cs.SessionFit, tmp_path: Path) -> None:
    path = tmp_path / "missing" / "cuffs.json"
    with pytest.raises(FileNotFoundError) as refused:
        cs.write_cuffs(path, fitted.cuffs)
    assert refused.value.filename == str(path)


def test_every_table_names_the_unit_of_its_columns(session: Path, fitted: cs.SessionFit) -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, every=40)
    cuff = fitted.cuffs["hand"]
    pull = next(iter(fitted.pulls.values())).pull
    for table, units in (
        (cs.read_recording(next(session.glob("*static*.mcap"))).load("/markers").to_dataframe(), {"ns", "mm"}),
        (motion.to_dataframe(), {"s", "rad", "m"}),
        (motion.to_dataframe("speeds"), {"s", "rad/s", "m/s"}),
        (pull.to_dataframe(), {"s", "N", "m"}),
        (cuff.trials_dataframe(), {"N/m", "N s/m", "m", "N"}),
        (cuff.covariance_dataframe(), {"N/m", "N s/m", "m"}),
        (cs.solve_motion(model, motion).to_dataframe(), {"s", "N"}),
    ):
        assert set(table.attrs["units"].values()) == units
        assert set(table.attrs["units"]) <= set(table.columns)
    trials = cuff.trials_dataframe().set_index("file")
    assert list(trials.index) == [trial.file for trial in cuff.trials]
    assert cuff.covariance_dataframe().loc["stiffness", "damping"] == cuff.covariance[0, 1]


def test_columns_that_are_no_coordinate_are_named_and_may_have_any_content() -> None:
    model = cs.load_model()
    table = cs.load_motion(model).to_dataframe().rename(columns={"shoulder_elv": "Shoulder_Elevation"})
    table = table.assign(subject="P01", emg=np.nan, **{"/jointset/elbow/elbow_flexion/speed": 1.0})
    motion = cs.load_motion(model, table)
    assert motion.missing == ("shoulder_elv",)
    assert [finding.code for finding in motion.findings] == ["motion.without_data", "motion.unused_columns"]
    assert motion.findings[1].figures == {"columns": "Shoulder_Elevation (shoulder_elv?), subject, emg"}


def test_a_motion_goes_through_a_table_and_back(tmp_path: Path) -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, cutoff_hz=None)
    again = cs.load_motion(model, motion.to_dataframe(), cutoff_hz=None)
    assert again == motion
    assert cs.load_motion(model, motion.to_dataframe().set_index("time_s"), cutoff_hz=None) == motion
    degrees = motion.to_dataframe()
    angles = [name for name, unit in degrees.attrs["units"].items() if unit == "rad"]
    degrees[angles] = np.degrees(degrees[angles])
    degrees.attrs["units"].update(dict.fromkeys(angles, "deg"))
    np.testing.assert_allclose(cs.load_motion(model, degrees, cutoff_hz=None).positions, motion.positions, atol=1e-12)
    turns, renamed = degrees.copy(), degrees.rename(columns={"shoulder_elv": "elevation"})
    turns.attrs["units"] = {**degrees.attrs["units"], angles[0]: "turns"}
    renamed.attrs["units"] = {"shoulder_elevation": "deg"}
    listed, unread = degrees.copy(), motion.to_dataframe()
    listed.attrs["units"], unread.attrs["units"] = {"shoulder_elv": ["deg"]}, {"other": ["deg"]}
    for table, code in (
        (turns, SolverCode.MALFORMED_TABLE),
        (renamed, SolverCode.MALFORMED_TABLE),
        (listed, SolverCode.MALFORMED_TABLE),
        (unread, SolverCode.MALFORMED_TABLE),
        (degrees.assign(shoulder_elv="high"), SolverCode.MALFORMED_TABLE),
        (degrees[:1], SolverCode.NO_FRAMES),
        (motion.to_dataframe().drop(columns="time_s"), SolverCode.MISSING_COLUMN),
        (motion.to_dataframe().replace(0.0, np.nan), SolverCode.NOT_FINITE),
        (motion.to_dataframe()[["time_s"]], SolverCode.MISSING_COLUMN),
    ):
        with pytest.raises(cs.SolverError) as refused:
            cs.load_motion(model, table)
        assert refused.value.code == code


def test_activations_are_given_in_every_condition_at_the_rest_length_that_is_asked_for() -> None:
    model = cs.load_model()
    motion = cs.load_motion(model, every=40)
    cuffs = [cs.Cuff(name, stiffness=8520, damping=210, migration=0.012) for name in ("hand", "tube")]
    lengths = {"rest_lengths": [0.6, 0.7, 0.8], "reference_rest_length": 0.7}
    assessment = cs.assess(cuffs, model, motion, people=0, **lengths)
    curves = assessment.effort_curves().set_index(["condition", "cuff", "rest_length_m"])["effort"]
    assert len(curves) == 7 * 3
    table = assessment.to_dataframe().set_index(["condition", "cuff"])
    assert curves["both", "tube", 0.7] == pytest.approx(table.loc[("both", "tube"), "effort_at_reference"], rel=1e-9)
    effort = [(assessment.activations(*of).iloc[:, 1:] ** 2).to_numpy().sum() for of in (("both", "tube"), ("slack",))]
    assert effort[0] / effort[1] == pytest.approx(curves["both", "tube", 0.7], rel=1e-9)
    data = assessment.to_xarray()
    assert data["activations"].sizes == {"curve": 7, "time": len(motion.time), "muscle": 33}
    assert data["rest_length"].attrs["units"] == "m"
    for asked in (("both", None), ("both", "elbow"), ("both", "")):
        with pytest.raises(ValueError, match="expected one of: slack, rigid, shift hand"):
            assessment.activations(*asked)
    with pytest.raises(cs.SolverError):
        cs.assess(cuffs, model, motion, rest_lengths=[-0.1])


def test_a_cost_of_the_users_own_is_that_of_the_assessment(fitted: cs.SessionFit) -> None:
    """Squares as a function have the figures of the built-in squares; another cost has others."""
    squares = cs.ActivationCost(lambda a: a**2, lambda a: 2 * a, lambda a: 2 + 0 * a)
    quartic = cs.ActivationCost(lambda a: a**4, lambda a: 4 * a**3, lambda a: 12 * a**2)
    built_in, own, steeper = (
        cs.assess(fitted, rest_lengths=[0.66, 0.7, 0.74], people=0, most_frames=4, options=options)
        .to_dataframe()["effort_at_reference"]
        .to_numpy()
        for options in (None, cs.RedundancyOptions(cost=squares), cs.RedundancyOptions(cost=quartic))
    )
    np.testing.assert_allclose(own, built_in, rtol=1e-7)
    assert (steeper < built_in - 0.05).all(), (
        "a steeper cost weighs the largest activations, which the suit lowers most"
    )


def test_every_part_of_two_equal_results_is_equal(session: Path, fitted: cs.SessionFit) -> None:
    """Arrays in a dataclass with the equality that Python writes raise ValueError."""
    first, second = fitted, cs.fit_session(session)
    assert first.cuffs["hand"].wearable() == second.cuffs["hand"].wearable()
    assert first.cuffs["hand"].parameters() == second.cuffs["hand"].parameters()
    assert first != cs.fit_session(session, window={"cuff-hand_test-dynamic_run-1.mcap": (0.5, 9.0)})
    model = cs.load_model()
    motions = [cs.load_motion(model, every=100) for _ in range(2)]
    reactions = cs.RedundancyOptions(reactions=cs.ReactionRequest(("GlenoHumeral",)))
    solutions = [cs.solve_motion(model, motion, reactions) for motion in motions]
    assessments = [cs.assess(first, model, motion, people=0) for motion in motions]
    parts = [(first, second), tuple(motions), tuple(solutions), tuple(assessments)]
    kinds = set()
    while parts:
        one, other = parts.pop()
        if isinstance(one, Mapping):
            parts += [(one[key], other[key]) for key in one]
        elif isinstance(one, tuple):
            parts += zip(one, other, strict=True)
        elif is_dataclass(one):
            kinds.add(type(one).__name__)
            assert one == other, type(one)
            parts += [(getattr(one, field.name), getattr(other, field.name)) for field in fields(one)]
    assert {"TrialFit", "Pull", "StaticFit", "DampingFit", "EffortCurve", "JointReactions"} <= kinds


def test_a_window_limits_the_samples_of_a_trial_and_is_noted(session: Path, fitted: cs.SessionFit) -> None:
    file = "cuff-hand_test-dynamic_run-1.mcap"
    whole, part = fitted, cs.fit_session(session, window={file: (0.5, 9.0)})
    time = part.pulls[file].pull.marker_time
    assert time[0] >= 0.5 and 8.9 < time[-1] <= 9.0
    (trial,) = [trial for trial in part.cuffs["hand"].trials if trial.file == file]
    assert TrialNoteCode.WINDOW in [note.code for note in trial.notes]
    damping, narrower = whole.cuffs["hand"].damping, part.cuffs["hand"].damping
    assert damping.value != narrower.value and abs(damping.value - narrower.value) < 4 * narrower.standard_error
    used = [session / trial.file for trial in whole.cuffs["hand"].trials]
    alone = cs.fit_donning([*used, *(session / bounce for bounce in whole.bounces)], window={file: (0.5, 9.0)})
    assert alone.damping == narrower
    for window in ({"other.mcap": (0.0, 1.0)}, {file: (5.0, 4.0)}, {file: (0.0, 1e4)}, (-1.0, 5.0)):
        with pytest.raises(ValueError, match=r"^window .* expected"):
            cs.fit_session(session, window=window)


def test_zero_drift_losses_and_weights_are_those_of_the_window(session: Path, fitted: cs.SessionFit) -> None:
    file = "cuff-hand_test-static_run-1.mcap"
    whole = fitted.pulls[file].pull.trial
    lossy = replace(whole, force_gaps=((1.0, 2.0), (15.0, 16.0)), step_times=(4.2, 9.1, 14.1), step_masses=(3.5, 3.5))
    unloaded, loaded = within(lossy, 1.5, whole.end), within(lossy, 8.0, whole.end)
    assert whole.zero_drift is not None and unloaded.zero_drift == pytest.approx(whole.zero_drift, abs=0.05)
    assert unloaded.force_gaps == ((1.5, 2.0), (15.0, 16.0)) and loaded.force_gaps == ((15.0, 16.0),)
    (note,) = [note for note in loaded.notes if note.code is TrialNoteCode.FORCE_LOST]
    assert note.figures["total_s"] == 1.0
    assert (unloaded.step_masses, unloaded.step_times) == ((3.5, 3.5), (4.2, 9.1, 14.1))
    assert (loaded.zero_drift, loaded.step_masses, loaded.step_times) == (None, (), (9.1, 14.1))
    assert loaded.sync == whole.sync, "the clocks are aligned by the whole capture"
    with pytest.raises(ValueError, match="expected force and markers"):
        within(whole, 1.0, 1.0001)
    part = cs.fit_session(session, window={file: (0.0, 0.5 * whole.end)}).cuffs["hand"]
    assert part.migration is None, "the load is on at the end"


def test_a_report_and_the_html_of_a_fit_state_its_figures(fitted: cs.SessionFit) -> None:
    cuff = fitted.cuffs["hand"]
    report = cuff.report()
    assert f"{cuff.stiffness.value:.0f} +/- {cuff.stiffness.standard_error:.0f} N/m" in report, (
        "two digits of the error"
    )
    assert f"{cuff.migration.value:.6f} +/- {cuff.migration.standard_error:.6f} m" in report
    assert all(cause in report for cause, part in cuff.damping.parts.items() if part)
    assert "C(stiffness, damping)" in report
    for result in (fitted, cuff, cuff.wearable()):
        assert f"<td>{plus_minus(cuff.stiffness.value, cuff.stiffness.ci95)}</td>" in result._repr_html_()
    assert cuff._repr_html_().count("<polyline") == len(cuff.pulls)


def test_a_picture_is_shown_without_pyplot_and_drawn_into_given_axes(fitted: cs.SessionFit) -> None:
    assert cs.plot(fitted)._repr_png_().startswith(b"\x89PNG")
    figure = Figure()
    one, three = figure.add_subplot(2, 1, 1), [figure.add_subplot(2, 3, place) for place in (4, 5, 6)]
    assert cs.plot(fitted, ax=one) is one
    assert cs.plot(fitted.cuffs["hand"], ax=three) is three
    assert len(one.lines) > 2 and all(axis.lines for axis in three)
    divided = Figure().add_subplot()
    assert cs.plot(fitted.cuffs["hand"], ax=divided) is divided
    assert [axis.get_xlabel() for axis in divided.child_axes] == [axis.get_xlabel() for axis in three]
    with pytest.raises(ValueError, match=r"^ax has 2 axes, expected one or 3"):
        cs.plot(fitted.cuffs["hand"], ax=three[:2])


def test_intervals_of_the_sample_session_contain_the_truth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", str(tmp_path))
    folder = cs.sample_session()
    assert folder.is_relative_to(tmp_path)
    damaged = next(folder.glob("*dynamic*"))
    damaged.write_bytes(bytes(damaged.stat().st_size))  # as after a power failure
    assert cs.sample_session() == folder
    cuff = cs.fit_session(folder).cuffs["hand"]
    assert cuff.missing == ()
    for estimate, truth in zip((cuff.stiffness, cuff.damping, cuff.migration), (8520.0, 210.0, 0.01201), strict=True):
        assert estimate.ci95[0] < truth < estimate.ci95[1]
    assert sum(path.stat().st_size for path in folder.iterdir()) < 1e6


@pytest.mark.parametrize("name", ["documents", "drivers", "fitting", "recordings", "solver", "station"])
@pytest.mark.parametrize("form", ["{}.py", "{}/__init__.py"])
def test_a_file_with_our_name_is_named(name: str, form: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / form.format(name)
    file.parent.mkdir(exist_ok=True)
    file.write_text("x = 1", encoding="utf-8")
    monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ImportError) as refused:
        cs._ensure_own_packages()
    assert (refused.value.name, refused.value.path) == (name, str(file))
    assert str(file) in str(refused.value)


def test_a_file_in_the_place_of_one_of_our_packages_is_named_and_tests_of_its_project_run(tmp_path: Path) -> None:
    """pytest loads our plugin in every project of an environment, also where drivers.py is the project's own."""
    (tmp_path / "drivers.py").write_text("ANSWER = 42\n", encoding="utf-8")
    (tmp_path / "test_mine.py").write_text(
        "import drivers\n\ndef test_mine():\n    assert drivers.ANSWER == 42\n\n"
        "def test_bench(simulated_bench):\n    pass\n",
        encoding="utf-8",
    )
    for command in (["-c", "import cuffstation as cs; cs.fit_session"], ["-m", "pytest", "-q", "-p", PLUGIN]):
        ours = {"PYTEST_DISABLE_PLUGIN_AUTOLOAD": "1", "PYTHONPATH": str(ROOT)}
        ran = run_python(*command, folder=tmp_path, patience_s=60, **ours)
        found = f"own package drivers, and Python finds {tmp_path / 'drivers.py'} in its place"
        assert ran.returncode == 1 and found in ran.stdout + ran.stderr, ran.stdout + ran.stderr
    assert "1 passed, 1 error" in ran.stdout
