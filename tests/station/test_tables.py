"""What a fit prints of a cuff that was pulled in several directions."""

from __future__ import annotations

import io

import numpy as np
from rich.console import Console

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.trial_fit import TrialFit
from fitting.results.codes import TensorCode, TrialNoteCode, Verdict
from fitting.results.rendering import Note
from fitting.spatial.tensor import Tensor
from fitting.spatial.tensors import Tensors
from station.tables import print_cuffs

PLANE = Note(TensorCode.ONE_PLANE, {"quantity": "stiffness", "test": "static", "directions": 3, "missing": "(0, 0, 1)"})
NO_ROPE = Note(TensorCode.NO_ROPE, {"quantity": "damping", "test": "dynamic"})
ANOTHER_LINE = Note(TrialNoteCode.ANOTHER_LINE, {"angle_deg": 30.0})


def _printed(tensors: Tensors, *notes: Note) -> str:
    trial = TrialFit("static-2", "s", "static", 2, 2, "used", notes=notes)
    fit = CuffFit(
        "hand",
        "arm",
        "1",
        None,
        None,
        None,
        (Verdict.NO_STATIC,),
        np.zeros((3, 3)),
        trials=(trial,),
        tensors=tensors,
    )
    console = Console(file=io.StringIO(), width=400)
    with console.capture() as capture:
        print_cuffs(SessionFit({"hand": {"1": fit}}, ()), console)
    return capture.get()


def test_principal_values_are_printed_with_their_half_widths_and_axes() -> None:
    tensor = Tensor(np.diag([1000.0, 2000.0, 3000.0]), 25.0 * np.eye(6), 2.0, 5)
    assert "stiffness in three dimensions [N/m]: 1000 ± 10 along (1.00, 0.00, 0.00); 2000" in _printed(
        Tensors(tensor, None, None, NO_ROPE)
    )


def test_too_few_directions_have_a_reason_and_a_single_direction_has_none() -> None:
    refused = Tensors(None, None, PLANE, NO_ROPE)
    assert str(PLANE) in _printed(refused, ANOTHER_LINE)
    assert str(PLANE) not in _printed(refused)
