"""Drawing all figures of a page: in their sections and order, counted one by one."""

import io
import re
from dataclasses import replace
from functools import partial
from itertools import combinations
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pandas as pd
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from PIL import Image

from solver.redundancy.effort import RedundancyOptions, static_optimisation
from station import charts
from station.assessment.drawn_postures import PostureEntry
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import solve_muscles
from station.charts.marks import Array, Line, Panel, chart
from station.charts.svg import draw
from station.report.assessment_section import ELEVATION, LESS, MORE, activation_changes, body_figure, change_colour
from station.report.pictures import PlannedPicture, draw_all
from station.report.plot import DPI, as_png
from station.report.rmr_figures import UNKNOWN, _activations, _glenoid, _joint_forces, _reserves
from tests.solver.legs import step_in

ACTIVATIONS = pd.DataFrame(
    {
        "condition": ["slack", "slack", "both", "both", "both", "both"],
        "cuff": ["", "", "hand", "hand", "tube", "tube"],
        "time_s": [0.0, 1.0, 0.0, 1.0, 0.0, 1.0],
        "deltoid": [0.4, 0.5, 0.3, 0.3, 0.9, 0.9],
        "serratus": [0.0, 0.0, 0.0, 0.2, 0.9, 0.9],
    }
)
DEUTERANOPIA = np.array(
    [[0.367322, 0.860646, -0.227968], [0.280085, 0.672501, 0.047413], [-0.011820, 0.042940, 0.968881]]
)
"""Machado, Oliveira and Fernandes (2009), IEEE Trans. Vis. Comput. Graph. 15:1291, severity 1, of linear RGB."""


def test_every_section_has_its_own_figures_in_their_order_and_progress_counts_them() -> None:
    reported: list[tuple[str, int, int]] = []
    planned = {"waist": [_planned("a"), _planned("b", is_wide=True)], None: [_planned("c")]}
    drawn = draw_all(planned, lambda *step: reported.append(step))
    captions = {section: [(picture.caption, picture.is_wide) for picture in part] for section, part in drawn.items()}
    assert captions == {"waist": [("a", False), ("b", True)], None: [("c", False)]}
    assert ">panel c</text>" in drawn[None][0].drawing
    assert reported == [("drawing figures", done, 3) for done in range(4)]
    assert draw_all({"waist": []}, lambda *step: reported.append(step)) == {"waist": ()}
    assert len(reported) == 4, "a page without figures counts none"


def _planned(caption: str, *, is_wide: bool = False) -> PlannedPicture:
    return PlannedPicture(partial(chart, Panel((), title=f"panel {caption}")), caption, is_wide)


# PNG of matplotlib's figures: always the same, opaque, of the size that was asked for.


def test_a_figure_is_opaque_of_the_size_asked_for_and_has_no_date_or_version() -> None:
    first, second = (as_png(_example()) for _ in range(2))
    assert first == second
    with Image.open(io.BytesIO(first)) as image:
        assert set(image.info) == {"dpi"}
        assert (image.mode, image.size, image.getpixel((0, 0))) == ("RGB", (3 * DPI, 2 * DPI), (255, 255, 255))


def _example() -> Figure:
    figure = Figure(figsize=(3.0, 2.0))
    figure.subplots().plot([0.0, 61.0], [-0.77, 2e6])
    return figure


# The picture of the body: colours by change, the nearest muscle in front, true proportions, clear to all eyes.


def _line(*points: tuple[float, float, float]) -> dict[str, Any]:
    return {"value": [[float(x) for x in point] for point in points], "ci95": None}


POSTURE = PostureEntry.model_validate(
    {
        "chosen_by": "elevation",
        "time_s": {"value": 0.9, "ci95": None},
        "elevation_deg": {"value": 90.0, "ci95": None},
        "bones": [{"kind": "shaft", "line_m": _line((0, 0, 0), (0, -0.3, 0))}],
        "muscles_m": {
            "deltoid": _line((0.1, 0, 0), (0.1, -0.1, 0)),  # before the body
            "serratus": _line((-0.1, 0, 0), (-0.1, -0.1, 0)),  # behind it
        },
        "cord_m": _line((0, 0.2, 0), (0, 0, 0.2)),
        "cuffs_m": {"arm": _line((0.2, 0, 0), (0, 0, 0.2))},
    }
)


def _muscles(view: int) -> list[Line]:
    columns = body_figure([POSTURE] * 3, ACTIVATIONS, "hand").columns
    assert len(columns) == 6, "two views of three postures"
    marks = columns[view][0].marks
    return [mark for mark in marks if isinstance(mark, Line) and mark.title.startswith(("deltoid", "serratus"))]


def test_a_change_is_that_of_the_cuff_at_the_time_of_the_posture() -> None:
    assert activation_changes(ACTIVATIONS, "hand", 0.9) == pytest.approx({"deltoid": -0.2, "serratus": 0.2})


def test_a_muscle_that_works_more_is_as_clear_as_one_that_works_less() -> None:
    for change, step in ((0.01, 0), (0.029, 0), (0.03, 1), (0.1, 2), (0.5, 2)):
        assert (change_colour(-change), change_colour(change)) == (LESS[step], MORE[step])
    assert change_colour(0.0099) == change_colour(-0.0099) == "same"
    less, more = sorted(_muscles(0), key=lambda line: line.title)
    assert (less.colour, more.colour) == ("less3", "more3")
    assert less.width == more.width
    assert "−0.200" in less.title and "+0.200" in more.title


def test_the_nearest_muscle_is_drawn_last() -> None:
    from_behind, from_the_front = ([line.title.split(":")[0] for line in _muscles(view)] for view in (0, 1))
    assert from_behind == ["deltoid", "serratus"]
    assert from_the_front == ["serratus", "deltoid"]


def test_proportions_are_true_and_there_are_no_axes() -> None:
    drawn = draw(body_figure([POSTURE] * 3, ACTIVATIONS, "hand"), "body")
    assert 'class="grid"' not in drawn and 'class="axis"' not in drawn
    bone = re.search(r'class="line bone ?" d="M([\d.]+) ([\d.]+)l(-?[\d.]+) (-?[\d.]+)"', drawn)
    cord = re.findall(r'class="line cord ?" d="M([\d.]+) ([\d.]+)l(-?[\d.]+) (-?[\d.]+)"', drawn)
    tilt = np.radians(ELEVATION)
    pixels_per_metre = float(bone[4]) / (0.3 * np.cos(tilt))
    x, y = (float(step) / pixels_per_metre for step in cord[1][2:])
    down = 0.2 * np.cos(tilt) + 0.2 * np.sin(tilt) * np.sin(np.radians(35.0))
    assert (abs(x), y) == pytest.approx((0.2 * np.cos(np.radians(35.0)), down), abs=0.005)


@pytest.mark.parametrize("scheme", [0, 1])
def test_less_and_more_are_distinguishable_with_deuteranopia(scheme: int) -> None:
    style = Path(charts.__file__).with_name("chart.css").read_text(encoding="utf-8")
    colours = {
        name: _lab(found[scheme]) for name in (*LESS, *MORE) if (found := re.findall(rf"--{name}: (#\w+)", style))
    }
    assert set(colours) == {*LESS, *MORE}
    for a, b in combinations(colours, 2):
        assert np.linalg.norm(colours[a] - colours[b]) > 12, f"{a} and {b}"


def _lab(colour: str) -> Array:
    """CIE L*a*b* (D65) as seen with deuteranopia; a difference of 2.3 is just seen."""
    rgb = np.array([int(colour[k : k + 2], 16) for k in (1, 3, 5)]) / 255
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    seen = np.clip(DEUTERANOPIA @ linear, 0.0, 1.0)
    xyz = np.array([[0.4124, 0.3576, 0.1805], [0.2126, 0.7152, 0.0722], [0.0193, 0.1192, 0.9505]]) @ seen
    f = np.cbrt(xyz / np.array([0.9505, 1.0, 1.089]))
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


# The page of `station rmr --plot` for a model without a glenoid.


def test_the_page_of_a_leg_without_a_requested_joint_names_the_option_and_no_glenoid() -> None:
    solved: Any = SimpleNamespace(solution=SimpleNamespace(joint_reactions=SimpleNamespace(labels=())))
    axis = Figure().subplots()
    axis.set_title("joint reaction in the plane of the glenoid", loc="left")
    _joint_forces(axis, solved)
    texts = [axis.get_title(loc="left"), *(text.get_text() for text in axis.texts)]
    assert "--joint" in " ".join(texts) and "glenoid" not in " ".join(texts)


@pytest.mark.parametrize(("frames", "muscles"), [(1, 1), (1, 4), (5, 1)])
def test_an_unsolved_frame_is_grey_also_where_it_or_its_muscle_is_alone(frames: int, muscles: int) -> None:
    unsolved = SimpleNamespace(time=0.01 * np.arange(frames), activations=np.full((frames, muscles), np.nan))
    model = SimpleNamespace(muscle_names=[f"muscle_{number}" for number in range(muscles)])
    figure: Any = Figure()
    canvas = FigureCanvasAgg(figure)
    _activations(figure, SimpleNamespace(solution=unsolved, model=model))  # type: ignore[arg-type]
    axis, *_ = figure.axes
    canvas.draw()
    across, up = axis.transAxes.transform((0.45, 0.45))
    pixels = np.asarray(canvas.buffer_rgba())
    middle = pixels[len(pixels) - int(up), int(across), :3]
    assert "#" + bytes(middle).hex() == UNKNOWN


def test_no_two_reserves_of_a_panel_are_drawn_alike(tmp_path: Path) -> None:
    step = step_in(tmp_path)
    inputs = MuscleInputs(step.motion, str(step.model), step.loads, actuators=(step.actuators,))
    options = static_optimisation(RedundancyOptions(joint="thigh_joint"))
    figure: Any = Figure()
    solved = solve_muscles(inputs, MotionCut(6.0, 0.2, 0.4, 5, "splines"), options)
    _reserves(figure, solved)
    drawn = [[(line.get_color(), line.get_linestyle()) for line in axis.lines] for axis in figure.axes]
    assert [len(set(lines)) for lines in drawn] == [8, 3]  # rotations, translations of the pelvis
    page: Any = Figure()
    _activations(page, solved)
    assert figure.axes[-1].get_xlim() == pytest.approx(page.axes[0].get_xlim())


@pytest.mark.parametrize(("farthest", "outside"), [(0.071, 0), (1.0, 1)])
def test_the_axes_of_the_glenoid_contain_the_reaction_or_say_how_far_it_is(farthest: float, outside: int) -> None:
    """Without the glenoid's constraint the reaction may pass far outside, and in the end be in its plane."""
    solved = solve_muscles(MuscleInputs(), MotionCut(every=200), static_optimisation(RedundancyOptions()))
    contact = np.full_like(solved.solution.contact, 0.038)
    contact[-1, 0] = -farthest
    page: Any = Figure()
    _glenoid(page, replace(solved, solution=replace(solved.solution, contact=contact)))
    axis, *_ = page.axes
    least, greatest = axis.get_xlim()
    points = 1e3 * contact[:, 0]
    assert int(((points < least) | (points > greatest)).sum()) == outside
    noted = [text.get_text() for text in axis.texts if "beyond" in text.get_text()]
    assert [("1000 mm" in note) for note in noted] == [True] * outside
