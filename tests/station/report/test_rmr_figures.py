"""The page of `station rmr --plot` for a model without a glenoid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from solver.redundancy.effort import RedundancyOptions, static_optimisation
from station.assessment.given_motion import MotionCut, MuscleInputs
from station.assessment.rmr import solve_muscles
from station.report.rmr_figures import UNKNOWN, _activations, _glenoid, _joint_forces, _reserves
from tests.solver.legs import step_in


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
