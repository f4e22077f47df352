"""Motions: files read in the unit their header states, the published filter, and sentences for what is missing."""

from dataclasses import replace

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.model import Coordinate, Model
from solver.motion import Motion, decimate, differentiate, read_motion, write_table
from tests.solver.refusals import raises_refusal

MOT = """Coordinates
version=1
nRows=3
nColumns=4
inDegrees={degrees}

endheader
time\tshoulder_elv\tthorax_tx\textra
0.00\t90\t0.5\t7
0.01\t180\t0.6\t7
0.02\t0\t0.7\t7
"""


def model(*names):
    """A model of nothing but coordinates; those ending in tx are translations."""
    kinds = ["translation" if name.endswith("tx") else "rotation" for name in names]
    coordinates = tuple(Coordinate(name, kind, 0.0, (-1.0, 1.0)) for name, kind in zip(names, kinds, strict=True))
    return Model("test", np.zeros(3), (), coordinates, (), (), (), (), (), ())


def sine(frequency, rate=100.0, duration=6.0):
    time = np.arange(0, duration, 1 / rate)
    return Motion(("angle",), time, np.sin(2 * np.pi * frequency * time)[:, None])


def gain(frequency):
    smooth = differentiate(sine(frequency)).positions[200:400, 0]
    return np.ptp(smooth) / np.ptp(sine(frequency).coordinates[200:400, 0])


@pytest.mark.parametrize(("degrees", "half_turn"), [("yes", np.pi), ("no", 180.0)])
def test_angles_follow_the_header_and_translations_stay_metres(tmp_path, degrees, half_turn):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees=degrees))
    motion = read_motion(path, model("thorax_tx", "shoulder_elv"))
    np.testing.assert_allclose(motion.coordinates[1], [0.6, half_turn])
    np.testing.assert_allclose(motion.time, [0, 0.01, 0.02])


def test_a_motion_file_of_simm_is_in_degrees_and_columns_may_be_paths_of_states(tmp_path):
    path = tmp_path / "raise.mot"
    text = MOT.format(degrees="yes").replace("version=1\n", "").replace("inDegrees=yes\n", "name raise\n")
    path.write_text(text.replace("shoulder_elv", "/jointset/shoulder/shoulder_elv/value"))
    motion = read_motion(path, model("thorax_tx", "shoulder_elv"))
    np.testing.assert_allclose(motion.coordinates[1], [0.6, np.pi])


def test_a_coordinate_without_a_column_keeps_its_default_on_request_but_not_all_of_them(tmp_path):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees="no"))
    body = model("shoulder_elv", "elbow_flexion")
    elbow = replace(body.coordinates[1], default=0.7)
    body = replace(body, coordinates=(body.coordinates[0], elbow))
    motion = read_motion(path, body, with_defaults=True)
    assert motion.missing == ("elbow_flexion",)
    np.testing.assert_allclose(motion.coordinates, [[90.0, 0.7], [180.0, 0.7], [0.0, 0.7]])


@pytest.mark.parametrize("with_defaults", [True, False])
def test_a_motion_of_another_model_is_called_that(tmp_path, with_defaults):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees="no"))
    with raises_refusal(SolverCode.MISSING_COLUMN, naming="raise.mot has no coordinate of the model"):
        read_motion(path, model("hip", "knee"), with_defaults=with_defaults)


@pytest.mark.parametrize("suffix", [".csv", ".sto", ".mot"])
def test_what_is_written_is_read_again(tmp_path, suffix):
    time, values = np.arange(5) / 100, np.random.default_rng(1).normal(size=(5, 2))
    path = tmp_path / f"table{suffix}"
    write_table(path, ["a", "b"], time, values)
    motion = read_motion(path, model("a", "b"))
    np.testing.assert_allclose(motion.time, time, atol=1e-12)
    np.testing.assert_allclose(motion.coordinates, values, rtol=1e-9)


def test_a_missing_coordinate_is_named(tmp_path):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees="yes"))
    with raises_refusal(SolverCode.MISSING_COLUMN, naming="elbow_flexion"):
        read_motion(path, model("shoulder_elv", "elbow_flexion"))


@pytest.mark.parametrize(
    ("text", "code", "naming"),
    [
        ("time\ta\n0\t1\n", SolverCode.MALFORMED_TABLE, "endheader"),
        ("endheader\ntime\ta\n0\t1\n0.01\t2\n0.02\n", SolverCode.MALFORMED_TABLE, "frame 3"),
        ("endheader\ntime\ta\n0\t1\n0.01\tnan\n0.02\t1\n", SolverCode.NOT_FINITE, "frame 1"),
        ("endheader\ntime\ta\n0\t1\n0.01\tone\n", SolverCode.MALFORMED_TABLE, "one"),
        ("endheader\ntime\ta\n0\t1\n0.01\t1\n0.03\t1\n0.04\t1\n", SolverCode.UNEVEN_TIME, "0.01 to 0.02 s"),
        ("endheader\ntime\ta\n", SolverCode.NO_FRAMES, "1 rows"),
    ],
)
def test_a_malformed_file_gives_one_sentence(tmp_path, text, code, naming):
    path = tmp_path / "bad.mot"
    path.write_text(text)
    with raises_refusal(code, naming):
        read_motion(path, model("a"))


def printed(path, time, digits):
    rows = "\n".join(f"{t:.{digits}f}\t0.5" for t in time)
    path.write_text(f"motion\nendheader\ntime\ta\n{rows}\n")
    return path


ONE = model("a")


@pytest.mark.parametrize(("rate", "digits"), [(60, 3), (60, 4), (97.8, 4), (120, 4), (29.97, 3)])
def test_times_rounded_to_few_decimals_are_even(tmp_path, rate, digits):
    motion = read_motion(printed(tmp_path / "m.mot", 2.0 + np.arange(300) / rate, digits), ONE)
    assert differentiate(motion, None).interval == pytest.approx(1 / rate, rel=3e-4)


@pytest.mark.parametrize("missing", [1, 20, 150, 298])
def test_a_frame_that_is_missing_is_no_rounding(tmp_path, missing):
    time = np.delete(np.arange(300) / 60, missing)
    with raises_refusal(SolverCode.UNEVEN_TIME):
        read_motion(printed(tmp_path / "m.mot", time, 3), ONE)


def test_steps_that_change_are_no_rounding(tmp_path):
    time = np.cumsum(np.linspace(0.016, 0.018, 300))
    with raises_refusal(SolverCode.UNEVEN_TIME):
        read_motion(printed(tmp_path / "m.mot", time, 3), ONE)


def test_the_filter_has_the_published_gains():
    # two passes of order 4 at 3 Hz: half the amplitude at 3 Hz, 0.963 at 2 Hz
    assert gain(3.0) == pytest.approx(0.5, abs=0.005)
    assert gain(2.0) == pytest.approx(0.963, abs=0.002)


def test_accelerations_are_the_published_differences():
    kinematics = differentiate(sine(1.0), cutoff=None)
    q = kinematics.positions
    np.testing.assert_allclose(
        kinematics.accelerations[2:-2], (q[4:] - 2 * q[2:-2] + q[:-4]) / (4 * 0.01**2), rtol=1e-9, atol=1e-9
    )


def test_cutting_a_motion_changes_no_frame_that_is_kept():
    whole, part = differentiate(sine(1.0)), differentiate(sine(1.0), start=2.0, end=3.0)
    assert len(part.time) == 101
    np.testing.assert_array_equal(part.accelerations, whole.accelerations[200:301])


def test_a_thinned_motion_knows_its_longer_interval():
    whole = differentiate(sine(1.0))
    part = decimate(whole, 7)
    assert part.interval == pytest.approx(0.07)
    np.testing.assert_array_equal(part.accelerations, whole.accelerations[::7])
    np.testing.assert_allclose(np.diff(part.time), part.interval)


def test_limits_outside_the_motion_are_refused():
    with raises_refusal(SolverCode.NO_FRAMES, naming="0 to 5.99 s and has no frame from 9 s;"):
        differentiate(sine(1.0), start=9.0)


@pytest.mark.parametrize(
    ("start", "end", "naming"),
    [
        (1.0, 0.9, "start 1 s should be before the end 0.9 s"),
        (np.nan, None, "the start of the interval is not a number"),
        (0, np.nan, "the end of the interval is not a number"),
    ],
)
def test_limits_that_are_no_interval_are_refused(start, end, naming):
    with raises_refusal(SolverCode.NO_FRAMES, naming):
        differentiate(sine(1.0), start=start, end=end)


def test_a_cutoff_above_half_the_rate_is_refused():
    with raises_refusal(SolverCode.WRONG_CUTOFF, naming="50 Hz"):
        differentiate(sine(1.0), cutoff=60.0)
