"""Angles of pennation with which OpenSim solves a model, and those that it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from solver.errors import SolverCode
from solver.osim.model_reader import read_osim
from tests.solver.oracle.test_muscles import span
from tests.solver.oracle.two_bodies import model_with, opensim
from tests.solver.refusals import raises_refusal

pytestmark = pytest.mark.oracle

RIGHT_ANGLE = float(np.pi / 2)
ANGLES = (-0.1, 0.0, 1.5, RIGHT_ANGLE - 1e-12, RIGHT_ANGLE, 1.571, 3.2)
KINDS = ("Millard2012EquilibriumMuscle", "Thelen2003Muscle", "DeGrooteFregly2016Muscle")


def written(folder: Path, kind: str, tag: str, angle: float) -> Path:
    """A model with a muscle "calf" that has this angle."""
    model, file = model_with(opensim.UniversalJoint), folder / "calf.osim"
    muscle = getattr(opensim, kind)()
    muscle.setName("calf")
    span(model, muscle)
    model.finalizeConnections()
    model.printToXML(str(file))
    before, after = file.read_text().split(f'<{kind} name="calf">')
    file.write_text(f'{before}<{kind} name="calf"><{tag}>{float(angle)!r}</{tag}>{after}')
    return file


@pytest.mark.parametrize("angle", ANGLES)
@pytest.mark.parametrize(
    ("kind", "tag"),
    [
        *((kind, "pennation_angle_at_optimal") for kind in KINDS),
        *((kind, "maximum_pennation_angle") for kind in KINDS[:2]),
    ],
)
def test_a_pennation_is_refused_where_opensim_refuses_it(kind: str, tag: str, angle: float, tmp_path: Path) -> None:
    file = written(tmp_path, kind, tag, angle)
    try:
        opensim.Model(str(file)).initSystem()
    except RuntimeError as refusal:
        assert tag in str(refusal)
        with raises_refusal(SolverCode.WRONG_PENNATION, naming="calf"):
            read_osim(file)
    else:
        assert read_osim(file).muscles[-1].name == "calf"
