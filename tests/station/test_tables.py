"""What a fit prints of a cuff that was pulled in several directions."""

from __future__ import annotations

import io

import numpy as np
from rich.console import Console

from fitting.result import CuffFit, SessionFit, TrialFit
from fitting.results.codes import Verdict
from fitting.spatial.directions import ELSEWHERE
from fitting.spatial.tensor import Tensor, Tensors
from station.tables import print_cuffs

PLANE = "stiffness in three dimensions needs pulls that span space"


def _printed(tensors: Tensors, *notes: str) -> str:
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
        print_cuffs(SessionFit({"hand": {"1": fit}}, (), {}), console)
    return capture.get()


def test_principal_values_are_printed_with_their_half_widths_and_axes() -> None:
    tensor = Tensor(np.diag([1000.0, 2000.0, 3000.0]), 25.0 * np.eye(6), 2.0, 5)
    assert "stiffness in three dimensions [N/m]: 1000 ± 10 along (1.00, 0.00, 0.00); 2000" in _printed(
        Tensors(tensor, None, "", "no")
    )


def test_a_set_of_directions_that_is_not_enough_says_why_and_one_line_alone_says_nothing() -> None:
    refused = Tensors(None, None, PLANE, "no swings")
    assert PLANE in _printed(refused, ELSEWHERE)
    assert PLANE not in _printed(refused)
