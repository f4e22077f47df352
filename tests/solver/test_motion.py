"""Motions: files read in the unit their header states, the published filter, and sentences for what is missing."""

from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from solver.constraint import CoordinateCoupler, CoordinateLock
from solver.errors import SolverCode
from solver.functions.coordinate_functions import polynomial
from solver.model import Coordinate, Model
from solver.motion import Motion, decimate, differentiate, limits_outside, read_motion
from solver.motion_splines import LEAST_FRAMES, differentiate_by_splines, held_by_constraints
from solver.suit.suit import read_suit
from solver.time_series_table import TableHeader, read_table, write_table
from tests.refusals import raises_refusal

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


IN_DEGREES, IN_RADIANS = MOT.format(degrees="yes"), MOT.format(degrees="no")
SIMM = IN_DEGREES.replace("version=1\n", "").replace("inDegrees=yes\n", "name raise\n")
STATES = "Coordinates\nnRows=3\nnColumns=4\nAngles are in degrees.\n" + MOT[MOT.index("endheader") :]
UNITS = {
    "header in degrees": ("raise.mot", IN_DEGREES, np.pi),
    "header in radians": ("raise.mot", IN_RADIANS, 180.0),
    "states without version, whose unit is in words": ("raise.sto", STATES, np.pi),
    "SIMM, with paths of states": (
        "raise.mot",
        SIMM.replace("shoulder_elv", "/jointset/shoulder/shoulder_elv/value"),
        np.pi,
    ),
}


@pytest.mark.parametrize(("name", "text", "half_turn"), UNITS.values(), ids=UNITS)
def test_angles_follow_the_header_and_translations_stay_metres(tmp_path, name, text, half_turn):
    (tmp_path / name).write_text(text)
    motion = read_motion(tmp_path / name, model("thorax_tx", "shoulder_elv"))
    np.testing.assert_allclose(motion.coordinates[1], [0.6, half_turn])
    np.testing.assert_allclose(motion.time, [0, 0.01, 0.02])


@pytest.mark.parametrize(
    ("line", "half_turn"),
    [
        ("inDegrees=yes\t\t\t", np.pi),  # as a spreadsheet fills it
        ("inDegrees=yes,,,", np.pi),
        ("inDegrees = y", np.pi),
        ("inDegrees\tYes", np.pi),
        ("inDegrees=no\t\t", 180.0),
    ],
)
def test_the_unit_of_angles_is_what_opensim_reads_in_the_header(tmp_path, line, half_turn):
    path = tmp_path / "raise.mot"
    text = MOT.replace("inDegrees={degrees}", line).replace("endheader", "endheader\t\t")
    path.write_text(text.replace("Coordinates", "Übung é"), encoding="latin-1")
    np.testing.assert_allclose(read_motion(path, model("thorax_tx", "shoulder_elv")).coordinates[1], [0.6, half_turn])
    if "," not in line:
        opensim = pytest.importorskip("opensim")
        storage = opensim.Storage(str(path))
        assert storage.isInDegrees() == (half_turn == np.pi)


def test_a_coordinate_without_a_column_keeps_its_default_on_request_but_not_all_of_them(tmp_path):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees="no"))
    body = model("shoulder_elv", "elbow_flexion")
    elbow = replace(body.coordinates[1], default=0.7)
    body = replace(body, coordinates=(body.coordinates[0], elbow))
    motion = read_motion(path, body, with_defaults=True)
    assert motion.missing == ("elbow_flexion",)
    np.testing.assert_allclose(motion.coordinates, [[90.0, 0.7], [180.0, 0.7], [0.0, 0.7]])
    assert "without data: elbow_flexion" in repr(differentiate(motion, None))


@pytest.mark.parametrize(
    ("names", "with_defaults", "naming"),
    [
        (("hip", "knee"), True, "raise.mot has no coordinate of the model"),
        (("hip", "knee"), False, "raise.mot has no coordinate of the model"),
        ((), True, "the model test should have coordinates"),
        (("shoulder_elv", "elbow_flexion"), False, "elbow_flexion"),
    ],
)
def test_a_motion_without_the_coordinates_of_the_model_is_refused(tmp_path, names, with_defaults, naming):
    path = tmp_path / "raise.mot"
    path.write_text(MOT.format(degrees="no"))
    with raises_refusal(SolverCode.MISSING_COLUMN, naming=naming):
        read_motion(path, model(*names), with_defaults=with_defaults)


@pytest.mark.parametrize("suffix", [".csv", ".sto", ".mot"])
def test_what_is_written_is_read_again(tmp_path, suffix):
    time, values = np.arange(5) / 100, np.random.default_rng(1).normal(size=(5, 2))
    path = tmp_path / f"table{suffix}"
    write_table(path, ["a", "b"], time, values)
    motion = read_motion(path, model("a", "b"))
    np.testing.assert_allclose(motion.time, time, atol=1e-12)
    np.testing.assert_allclose(motion.coordinates, values, rtol=1e-9)


@pytest.mark.parametrize(
    ("name", "separator", "header"),
    [("m.csv", ",", ""), ("m.csv", ",", "\ufeff"), ("m.mot", "\t", "inDegrees=no\nendheader\n")],
    ids=["csv", "csv with a byte order mark", "mot"],
)
def test_the_name_of_a_coordinate_may_contain_spaces(tmp_path, name, separator, header):
    rows = (("time", "elbow flexion"), ("0", "1"), ("0.01", "2"), ("0.02", "3"))
    text = header + "\n".join(separator.join(row) for row in rows) + "\n"
    (tmp_path / name).write_text(text, encoding="utf-8")
    motion = read_motion(tmp_path / name, model("elbow flexion"))
    np.testing.assert_array_equal(motion.coordinates[:, 0], [1, 2, 3])


@pytest.mark.parametrize(
    ("text", "code", "naming"),
    [
        ("time\ta\n0\t1\n", SolverCode.MALFORMED_TABLE, "endheader"),
        ("endheader\ntime\ta\n0\t1\n0.01\t2\n0.02\n", SolverCode.MALFORMED_TABLE, "frame 3"),
        ("endheader\ntime\ta\n0\t1\n0.01\tnan\n0.02\t1\n", SolverCode.NOT_FINITE, "a nan in frame 2"),
        ("endheader\ntime\ta\n0\t1\n0.01\t1\n0.01\t2\n0.02\t1\n", SolverCode.UNEVEN_TIME, "has 0.01 s after"),
        ("endheader\ntime\ta\n0.02\t1\n0.01\t1\n0\t1\n", SolverCode.UNEVEN_TIME, "times that increase"),
        ("endheader\ntime\ta\n" + "0\t0.5\n" * 30, SolverCode.UNEVEN_TIME, ""),
        ("endheader\ntime\ta\n" + "1\t0\n1\t9\n" * 10, SolverCode.UNEVEN_TIME, "has 1 s after"),
        ("inDegrees=1\nendheader\ntime\ta\n0\t1\n0.01\t2\n", SolverCode.MALFORMED_TABLE, "inDegrees=yes"),
        ("endheader\ntime\ta\n0\t1\n0.01\tone\n", SolverCode.MALFORMED_TABLE, "one"),
        ("endheader\ntime\ta\n", SolverCode.NO_FRAMES, "1 row"),
        ("endheader\ntime\ta\ta\n0\t1\t2\n0.01\t1\t2\n", SolverCode.MALFORMED_TABLE, "several for a"),
    ],
)
def test_a_malformed_file_gives_one_sentence(tmp_path, text, code, naming):
    path = tmp_path / "bad.mot"
    path.write_text(text)
    with raises_refusal(code, naming):
        read_motion(path, model("a"))


def printed(path, time, digits, decimals=None):
    """A constant, or sin(9 t) with these decimals."""
    values = ["0.5" if decimals is None else f"{np.sin(9 * t):.{decimals}f}" for t in time]
    rows = "\n".join(f"{t:.{digits}f}\t{value}" for t, value in zip(time, values, strict=True))
    path.write_text(f"motion\nendheader\ntime\ta\n{rows}\n")
    return path


def test_markers_are_no_motion(tmp_path):
    (tmp_path / "walk.trc").write_text("PathFileType\t4\t(X/Y/Z)\twalk.trc\n")
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming="walk.trc should be a table over time"):
        read_motion(tmp_path / "walk.trc", model("a"))


ONE = model("a")


@pytest.mark.parametrize(("rate", "digits"), [(60, 3), (60, 4), (97.8, 4), (120, 4), (29.97, 3)])
def test_times_rounded_to_few_decimals_are_even(tmp_path, rate, digits):
    motion = read_motion(printed(tmp_path / "m.mot", 2.0 + np.arange(300) / rate, digits), ONE)
    assert differentiate(motion, None).interval == pytest.approx(1 / rate, rel=3e-4)


@pytest.mark.parametrize("missing", [1, 20, 150, 298])
def test_a_frame_that_is_missing_is_no_rounding(tmp_path, missing):
    time = np.delete(np.arange(300) / 60, missing)
    motion = read_motion(printed(tmp_path / "m.mot", time, 3), ONE)
    assert motion.steps == pytest.approx((0.016, 0.034), abs=0.0011)


@pytest.mark.parametrize(("value", "is_refused"), [("1e200", True), ("-2e6", True), ("-9e5", False)])
def test_a_value_that_no_coordinate_reaches_is_refused(tmp_path, value, is_refused):
    path = tmp_path / "m.mot"
    path.write_text(f"m\ninDegrees=no\nendheader\ntime\ta\tforce\n0\t1\t1e200\n0.01\t{value}\t0\n0.02\t1\t0\n")
    with raises_refusal(SolverCode.IMPOSSIBLE_VALUE, naming="in frame 2") if is_refused else nullcontext():
        read_motion(path, ONE)


@pytest.mark.parametrize("derive", [differentiate, differentiate_by_splines])
def test_kinematics_keep_the_recorded_steps_of_a_motion(tmp_path, derive):
    time = np.cumsum(np.linspace(0.016, 0.018, 300))
    kinematics = derive(read_motion(printed(tmp_path / "m.mot", time, 3), ONE), 3.0)
    np.testing.assert_allclose(kinematics.steps, (0.016, 0.018), rtol=1e-9)
    assert "interpolated from steps of 0.016 to 0.018 s" in repr(kinematics)


def test_a_motion_with_steps_of_an_integrator_is_interpolated(tmp_path):
    whole = np.arange(300) / 1000
    time = np.sort(np.concatenate([whole, whole[40:80:7] + 2e-4, [whole[-1] + 3.3e-4]]))
    motion = read_motion(printed(tmp_path / "rra.sto", time, 10, 12), ONE)
    np.testing.assert_allclose(motion.time, whole, atol=1e-12)
    np.testing.assert_allclose(motion.coordinates[:, 0], np.sin(9 * whole), atol=1e-11)
    np.testing.assert_allclose(motion.steps, (2e-4, 1e-3), rtol=1e-9)


@pytest.mark.parametrize("derive", [differentiate, differentiate_by_splines])
@pytest.mark.parametrize(
    ("rate", "missing", "cutoff", "is_gap"),
    [
        (200, [301, 302], 6.0, False),  # 15 ms of at most 16.7
        (200, [301, 302, 303], 6.0, True),  # 20 ms
        (200, [301, 302, 303], 3.0, False),
        (100, [150], 6.0, True),
        (100, [150], 4.0, False),
        (200, [301], None, False),  # 10 ms
        (200, [301, 302], None, True),
        (1000, range(1300, 2300), 3.0, True),
    ],
)
def test_a_gap_is_judged_by_its_duration_over_the_period_of_the_cut_off(
    tmp_path, derive, rate, missing, cutoff, is_gap
):
    whole = np.arange(3 * rate) / rate
    motion = read_motion(printed(tmp_path / "m.sto", np.delete(whole, missing), 6, 9), ONE)
    with raises_refusal(SolverCode.UNEVEN_TIME, naming="fill the gap") if is_gap else nullcontext():
        assert derive(motion, cutoff).interval == pytest.approx(1 / rate)
    if not is_gap:
        np.testing.assert_allclose(motion.time, whole, atol=1e-9)
        np.testing.assert_allclose(motion.coordinates[:, 0], np.sin(9 * whole), atol=2e-4)


def integrator_steps(longest):
    """Times of a variable-step integrator: from 1e-7 s to the longest [s]."""
    steps = np.random.default_rng(4).uniform(0.0, 1.0, round(8 / longest)) ** 3 * longest
    return np.append(0.0, np.cumsum(np.maximum(steps, 1e-7)))


@pytest.mark.parametrize(("longest", "decimals"), [(0.0012, 9), (0.0099, 9), (0.0099, 7)])
def test_steps_of_an_integrator_give_the_acceleration_of_the_motion(tmp_path, longest, decimals):
    motion = read_motion(printed(tmp_path / "cmc.sto", integrator_steps(longest), 9, decimals), ONE)
    kinematics = differentiate_by_splines(motion, 6.0)
    middle = slice(len(kinematics.time) // 4, -len(kinematics.time) // 4)
    expected = -81 * np.sin(9 * kinematics.time)
    np.testing.assert_allclose(kinematics.accelerations[middle, 0], expected[middle], atol=1.0)


def test_a_step_is_a_gap_by_its_length_over_the_period_of_the_cut_off(tmp_path):
    motion = read_motion(printed(tmp_path / "cmc.sto", integrator_steps(0.0099), 9), ONE)
    with raises_refusal(SolverCode.UNEVEN_TIME, naming="cut-off of 20 Hz"):
        differentiate_by_splines(motion, 20.0)


def test_a_row_that_repeats_the_one_before_is_left_out(tmp_path):
    path = printed(tmp_path / "rra.sto", np.arange(40) / 100, 6)
    lines = path.read_text().splitlines()
    at = lines.index(next(line for line in lines if line.startswith("time"))) + 1
    path.write_text("\n".join([*lines[: at + 9], lines[at + 8], *lines[at + 9 :], lines[-1]]) + "\n")
    motion = read_motion(path, ONE)
    np.testing.assert_allclose(motion.time, np.arange(40) / 100)
    assert differentiate(motion).repeated_rows == motion.repeated_rows == 2
    time, value = lines[-1].split()
    path.write_text("\n".join([*lines, f"{time}\t{float(value) + 1e-6}"]) + "\n")
    with raises_refusal(SolverCode.UNEVEN_TIME, naming="0.39 s after an equal"):
        read_motion(path, ONE)


@pytest.mark.parametrize("rate", [1000, 500, 100, 60])
@pytest.mark.parametrize(("in_second", "naming"), [(1e3, "in ms"), (1e6, "in µs"), (1e9, "in ns")])
def test_a_motion_in_smaller_units_of_time_is_refused(tmp_path, rate, in_second, naming):
    with raises_refusal(SolverCode.TIME_UNIT, naming=naming):
        read_motion(printed(tmp_path / "m.mot", in_second * np.arange(60) / rate, 6), ONE)


@pytest.mark.parametrize(("seconds", "is_refused"), [(1.0, False), (1 / 60, True)])
@pytest.mark.parametrize(("rate", "speed"), [(20, 3.0), (100, 1.0), (1000, 0.8)])
def test_a_motion_in_minutes_is_refused(tmp_path, rate, speed, seconds, is_refused):
    time = np.arange(2 * rate) / rate
    path = tmp_path / "m.csv"
    header = f"time,{ONE.coordinate_names[0]}"
    np.savetxt(path, np.column_stack([seconds * time, np.sin(speed * time)]), "%.9f", ",", header=header, comments="")
    with raises_refusal(SolverCode.TIME_UNIT, naming="multiply them by 60") if is_refused else nullcontext():
        read_motion(path, ONE)


@pytest.mark.parametrize("differentiate_it", [differentiate, differentiate_by_splines])
def test_a_short_motion_whose_cutoff_is_too_high_may_be_in_milliseconds(tmp_path, differentiate_it):
    motion = read_motion(printed(tmp_path / "m.mot", 10.0 * np.arange(9), 6), ONE)
    with raises_refusal(SolverCode.WRONG_CUTOFF, naming="if the times are in ms"):
        differentiate_it(motion, 6.0)


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


def test_a_decimated_motion_has_a_longer_interval():
    whole = differentiate(sine(1.0))
    part = decimate(whole, 7)
    assert part.interval == pytest.approx(0.07)
    np.testing.assert_array_equal(part.accelerations, whole.accelerations[::7])
    np.testing.assert_allclose(np.diff(part.time), part.interval)


def test_limits_outside_the_motion_are_refused():
    with raises_refusal(SolverCode.NO_FRAMES, naming="0 to 5.99 s and has no frame from 9 s;"):
        differentiate(sine(1.0), start=9.0)


@pytest.mark.parametrize(
    ("start", "end", "named"),
    [
        (None, None, ""),
        (0.0, 5.99, ""),
        (-0.01, 6.0, ""),  # a step next to it
        (-0.02, 5.0, "from -0.02 s"),
        (1.0, 9.0, "to 9 s"),
        (-np.inf, np.inf, ""),
        (-1.0, 9.0, "from -1 s to 9 s"),
    ],
)
def test_limits_outside_a_motion_are_named_by_more_than_a_step(start, end, named):
    assert limits_outside(sine(1.0).time, start, end) == named


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


# Splines of a motion: derivatives beside those known exactly, the gain of the filter, and what constraints hold.


TIME = np.arange(201) / 100


def motion(time=TIME, frequency=1.0):
    phase = 2 * np.pi * frequency * time
    return Motion(("knee", "patella", "toes"), time, np.column_stack([np.sin(phase), np.cos(phase), 0.1 + 0 * time]))


@pytest.mark.parametrize("accelerations", ["curvatures", "slopes_of_speeds"])
def test_derivatives_of_a_sine_are_exact_away_from_the_ends(accelerations):
    found = differentiate_by_splines(motion(), None, 0.5, 1.5, accelerations)
    rate, phase = 2 * np.pi, 2 * np.pi * found.time
    np.testing.assert_allclose(found.speeds[:, 0], rate * np.cos(phase), atol=1e-6)
    np.testing.assert_allclose(found.accelerations[:, 0], -(rate**2) * np.sin(phase), atol=1e-4)
    np.testing.assert_allclose(found.positions[:, 2], 0.1, atol=1e-12)
    assert len(found.time) == 101
    assert found.filter == "none"


@pytest.mark.parametrize(("frequency", "gain"), [(1.0, 1.0), (6.0, 0.5), (20.0, 0.0)])
def test_the_filter_halves_its_cutoff_frequency(frequency, gain):
    """Each of the two passes leaves 1/√2 of it."""
    found = differentiate_by_splines(motion(frequency=frequency), 6.0, 0.5, 1.5)
    assert np.ptp(found.positions[:, 0]) / 2 == pytest.approx(gain, abs=0.01)
    assert found.filter == "Butterworth low-pass at 6 Hz, order 3, forwards and backwards"


@pytest.mark.parametrize("accelerations", ["curvatures", "slopes_of_speeds"])
def test_times_that_were_rounded_change_no_acceleration(accelerations):
    """A walk of 1.3 m/s at 120 Hz: 5 µs of rounding over a step of 8 ms would be 0.2 m/s²."""
    exact = 0.125 + np.arange(125) / 120
    phase = 2 * np.pi * exact
    walk = np.column_stack([1.3 * exact + 0.02 * np.sin(phase), np.sin(phase), np.cos(phase)])
    found, expected = (
        differentiate_by_splines(Motion(("x", "y", "z"), time, walk), 6.0, accelerations=accelerations)
        for time in (exact.round(5), exact)
    )
    np.testing.assert_allclose(found.accelerations, expected.accelerations, rtol=1e-4, atol=1e-4)


def test_constraints_hold_what_is_locked_and_what_follows():
    coordinates = tuple(Coordinate(name, "rotation", 0.0, (-1.0, 1.0)) for name in ("knee", "patella", "toes"))
    follows = CoordinateCoupler("follows", 1, (0,), (polynomial([0.2, 0.5, 0.3]),))
    constraints = (follows, CoordinateLock("locked", 2, -0.4))
    body = Model("test", np.zeros(3), (), coordinates, (), (), (), constraints, (), ())
    free = differentiate_by_splines(motion())
    held = held_by_constraints(body, free)
    knee = free.positions[:, 0]
    np.testing.assert_allclose(held.positions[:, 1], 0.2 + 0.5 * knee + 0.3 * knee**2, atol=1e-12)
    np.testing.assert_array_equal(held.positions[:, 2], -0.4)
    np.testing.assert_array_equal(held.speeds[:, 2], 0.0)
    numeric = np.gradient(held.positions[:, 1], 0.01)
    np.testing.assert_allclose(held.speeds[2:-2, 1], numeric[2:-2], atol=0.02)
    numeric = np.gradient(held.speeds[:, 1], 0.01)
    np.testing.assert_allclose(held.accelerations[2:-2, 1], numeric[2:-2], atol=0.3)
    np.testing.assert_array_equal(held_by_constraints(body, free, ("toes",)).positions[:, :2], free.positions[:, :2])


def test_a_motion_that_is_too_short_or_a_cutoff_that_is_too_high_is_refused():
    with raises_refusal(SolverCode.NO_FRAMES):
        differentiate_by_splines(motion(TIME[: LEAST_FRAMES - 1]))
    with raises_refusal(SolverCode.WRONG_CUTOFF):
        differentiate_by_splines(motion(), 50.0)


# Tables over time: the header's number of rows beside the file's, and numbers with a decimal comma.


ROWS = "time\ta\n0\t1\n0.01\t2\n0.02\t3\n"


@pytest.mark.parametrize(
    ("line", "stated"),
    [
        ("nRows=3", 3),
        ("nRows=5", 5),
        ("nRows = 2\t\t", 2),
        ("datarows 5", 5),
        ("nRows=", None),
        ("nRows=-1", None),
        (f"nRows={'9' * 5000}", None),
    ],
)
def test_all_rows_are_read_whatever_the_header_states(tmp_path, line, stated):
    path = tmp_path / "m.sto"
    path.write_text(f"m\nversion=1\n{line}\nnColumns=2\nendheader\n{ROWS}")
    names, table, header = read_table(path)
    assert names == ["time", "a"]
    np.testing.assert_array_equal(table[:, 1], [1, 2, 3])
    assert header == TableHeader(rows=stated)


@pytest.mark.parametrize(
    ("above", "written", "end", "last"),
    [
        (20, "{}.125", "3.125\n", 3.125),
        (20, "{}.125", "3.125", 3.125),
        (20, "{}.125", "3.12", None),
        (20, "{}.125", "3", None),
        (20, "{}.125e-10", "3.125e-1", None),
        (20, "{}.125", "3.12\n", 3.12),
        (20, "{}.125", "nan", np.nan),
        (19, "{}.125", "3.12", 3.12),  # too few rows to know how numbers are written
        (20, "{}.25", "3.5", 3.5),  # a program that drops zeros at the end
        (20, "{}.5", "9", 9.0),
    ],
)
def test_a_last_number_that_was_cut_is_no_other_number(
    tmp_path, above: int, written: str, end: str, last: float | None
) -> None:
    path = tmp_path / "m.sto"
    rows = "".join(f"{row / 100}\t{written.format(row)}\n" for row in range(above))
    path.write_text(f"m\nendheader\ntime\ta\n{rows}0.50\t{end}")
    if last is None:
        with raises_refusal(SolverCode.MALFORMED_TABLE, naming="decimals"):
            read_table(path, may_have_gaps=True)
    else:
        np.testing.assert_equal(read_table(path, may_have_gaps=True)[1][-1, 1], last)
    path.write_text(path.read_text().replace("0\t0.125", "0\t0.5"))  # decimals differ, as written by %g
    np.testing.assert_equal(read_table(path, may_have_gaps=True)[1][-1, 1], float(end))


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be", "utf-32"])
@pytest.mark.parametrize("name", ["m.sto", "m.csv"])
def test_a_table_in_utf16_is_refused_with_its_encoding(tmp_path, name: str, encoding: str) -> None:
    path = tmp_path / name
    path.write_text(f"m\nendheader\n{ROWS}", encoding=encoding)
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming="UTF-16"):
        read_table(path)


@pytest.mark.parametrize(("stated", "of_storage"), [(3, 3), (5, 3), (2, 2)])
def test_opensim_takes_a_cut_file_and_its_storage_no_more_rows_than_stated(
    tmp_path, stated: int, of_storage: int
) -> None:
    opensim = pytest.importorskip("opensim")
    path = tmp_path / "m.sto"
    path.write_text(f"m\nversion=1\nnRows={stated}\nnColumns=2\ninDegrees=no\nendheader\n{ROWS}")
    assert opensim.Storage(str(path)).getSize() == of_storage
    assert opensim.TimeSeriesTable(str(path)).getNumRows() == len(read_table(path)[1]) == 3


@pytest.mark.parametrize(
    ("name", "names", "rows", "shown"),
    [
        ("m.csv", "time,a", ["0,00,1,5", "0,01,1,6"], "0,00"),
        ("m.csv", "time,a", ["0,1,5", "0,01,1,6"], "0,1"),
        ("m.csv", "time;a", ["0,00;1,5", "0,01;1,6"], "0,00"),
        ("m.csv", "time;a", ["0;1,5e-3", "1;1,6"], "1,5e-3"),
        ("m.sto", "time\ta", ["0,00\t-1,5", "0,01\t1,6"], "0,00"),
        ("m.mot", "time a", ["0 1,5", "1 1,6"], "1,5"),
        ("m.sto", "time\thip flexion", ["0,00\t1,5", "0,01\t1,6"], "0,00"),
        ("m.sto", "time\ta", ["0\t1", "0,01\t1,6"], "0,01"),
    ],
)
def test_a_decimal_comma_is_named(tmp_path, name: str, names: str, rows: list[str], shown: str) -> None:
    head = "" if name.endswith(".csv") else "m\nendheader\n"
    (tmp_path / name).write_text("\n".join([head + names, *rows]) + "\n")
    with raises_refusal(SolverCode.MALFORMED_TABLE, naming=f"decimal comma, as in {shown};"):
        read_table(tmp_path / name)


@pytest.mark.parametrize("rows", [["0,1", "0.01,2,3"], ["0.5,1,2", "1.5,2,3"], ["0,one", "1,two"]])
def test_another_fault_is_not_called_a_decimal_comma(tmp_path, rows: list[str]) -> None:
    path = tmp_path / "m.csv"
    path.write_text("\n".join(["time,a", *rows]) + "\n")
    with raises_refusal(SolverCode.MALFORMED_TABLE) as refused:
        read_table(path)
    assert "decimal comma" not in str(refused.value)


@pytest.mark.parametrize(
    ("read", "code"), [(read_table, SolverCode.UNREADABLE_TABLE), (read_suit, SolverCode.SUIT_FILE)]
)
def test_a_file_that_cannot_be_read_is_named_once(tmp_path, read: Callable[[Path], object], code: SolverCode) -> None:
    path = tmp_path / "missing.file"
    with raises_refusal(code) as caught:
        read(path)
    assert str(caught.value).count(str(path)) == 1
