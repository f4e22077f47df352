"""The functions of the public package on a leg with a free pelvis, beside the verb that solves the same files."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

import cuffstation as cs
from solver.errors import MotionError, SolverCode
from solver.model import ModelError
from solver.suit.suit import SuitError
from station.messages.assessment_messages import AssessmentCode
from tests.refusals import raises_refusal
from tests.solver.legs import LEG, PELVIS, Step, step_in

FRAMES = slice(20, 26)
OPTIONS = cs.RedundancyOptions(reactions=cs.ReactionRequest(("shank_joint",)))


@pytest.fixture(scope="module")
def step(tmp_path_factory: pytest.TempPathFactory) -> Step:
    return step_in(tmp_path_factory.mktemp("step"))


def solve(step: Step, model: cs.Model) -> cs.MotionSolution:
    motion = cs.load_motion(model, step.motion, cutoff_hz=6.0).cut(FRAMES)
    return cs.solve_motion(model, motion, OPTIONS, external_loads=step.loads)


def test_a_free_pelvis_is_solved_as_by_the_verb(step: Step, station, tmp_path: Path) -> None:
    solution = solve(step, cs.load_model(step.model, actuators=[step.actuators]))
    files = ("--model", step.model, "--motion", step.motion, "--external-loads", step.loads)
    given = ("--actuators", step.actuators, "--cutoff-hz", 6, "--from", 0.2, "--to", 0.25, "--joint", "shank_joint")
    assert station("rmr", *files, *given, "--output", tmp_path / "a.csv").code == 0
    table = pd.read_csv(tmp_path / "a.csv", comment="#")
    np.testing.assert_allclose(solution.activations, table[list(solution.muscles)], atol=1e-7)
    forces = table[[f"reaction_force_n.shank_joint_on_shank_in_ground.{axis}" for axis in "xyz"]]
    np.testing.assert_allclose(solution.joint_reactions.force[:, 0], forces, rtol=1e-7, atol=1e-6)


def test_reserves_in_python_are_those_of_the_file(step: Step) -> None:
    bare = cs.load_model(step.model)
    with raises_refusal(SolverCode.NOT_BALANCED, kind=ModelError):
        solve(step, bare)
    forces = dict.fromkeys(PELVIS, 500.0) | dict.fromkeys(LEG, 5.0)
    added = cs.with_reserves(bare, {name: cs.Reserve(force) for name, force in forces.items()})
    of_file = solve(step, cs.load_model(step.model, actuators=[step.actuators]))
    np.testing.assert_allclose(solve(step, added).activations, of_file.activations, atol=1e-9)


def test_forces_that_the_solver_lacks_are_left_out_on_request(step: Step, tmp_path: Path) -> None:
    file = tmp_path / "contact.osim"
    lacking = "<ElasticFoundationForce name='sole'/></objects></ForceSet>"
    file.write_text(step.model.read_text(encoding="utf-8").replace("</objects></ForceSet>", lacking), encoding="utf-8")
    with raises_refusal(SolverCode.UNSUPPORTED, kind=ModelError):
        cs.load_model(file)
    model = cs.load_model(file, ignore_forces=True, actuators=[step.actuators])
    assert model.lacking == ("sole",)
    (found,) = [found for found in solve(step, model).findings if found.code == AssessmentCode.LEFT_OUT]
    assert found.figures["parts"] == "ElasticFoundationForce sole"
    assert "N at pelvis_ty" in str(found.figures["effect"])


def test_files_of_actuators_that_cannot_be_added_are_refused(step: Step) -> None:
    for source, actuators, code in (
        ("bundled", [step.actuators], SolverCode.WRONG_OPTION),
        (step.model, step.actuators, SolverCode.WRONG_OPTION),
        (step.model, str(step.actuators), SolverCode.WRONG_OPTION),
        (step.model, [step.model], SolverCode.WRONG_DOCUMENT),
    ):
        with raises_refusal(code, kind=ModelError):
            cs.load_model(source, actuators=actuators)
    twice = cs.load_model(step.model, actuators=[step.actuators, step.actuators])
    with raises_refusal(SolverCode.UNSUPPORTED, kind=ModelError):
        solve(step, twice)


@pytest.mark.parametrize("values", [(0.0,), (-1.0,), (np.nan,), (np.inf,), (1.0, 0.5), (1.0, -1.0, np.nan)])
def test_a_reserve_that_effort_toml_refuses_is_refused(values: tuple[float, ...]) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, kind=ModelError):
        cs.Reserve(*values)


def test_a_motion_without_frames_is_refused_where_it_is_cut(step: Step) -> None:
    motion = cs.load_motion(cs.load_model(step.model), step.motion, cutoff_hz=6.0)
    with raises_refusal(SolverCode.NO_FRAMES, kind=MotionError):
        motion.cut(slice(0, 0))


def test_a_solution_without_a_solved_frame_is_described_without_a_warning(step: Step) -> None:
    weak = cs.with_reserves(cs.load_model(step.model), dict.fromkeys((*PELVIS, *LEG), cs.Reserve(1.0, -1.0, 1.0)))
    solution = solve(step, weak)
    assert solution.unsolved == len(solution.time)
    assert "nan" not in repr(solution)


@pytest.mark.parametrize(
    "ask",
    [
        lambda: cs.assess({}, people=-5),
        lambda: cs.assess({}, people=39),
        lambda: cs.assess({}, people=2.5),  # type: ignore[arg-type]
        lambda: cs.assess({}, sources="fit"),  # type: ignore[arg-type]
        lambda: cs.assess({}, most_frames=0),
        lambda: cs.open_stream([]),
        lambda: cs.open_stream({"ts": 0.0, "ai": 0.0}),
        lambda: cs.load_motion(cs.load_model(), every=0),
        lambda: cs.load_motion(cs.load_model(), every=-1),
    ],
)
def test_options_that_cannot_be_are_refused(ask: Callable[[], object]) -> None:
    with raises_refusal(SolverCode.WRONG_OPTION, kind=ModelError):
        ask()


def test_no_cuff_is_refused() -> None:
    with raises_refusal(SolverCode.NO_ARM_CUFF, kind=SuitError):
        cs.assess([])
