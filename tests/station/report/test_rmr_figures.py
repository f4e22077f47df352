"""The page of `station rmr --plot` for a model without a glenoid."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from matplotlib.figure import Figure

from station.report.rmr_figures import _joint_forces


def test_a_leg_without_a_requested_joint_is_told_how_to_request_one_and_not_of_a_glenoid() -> None:
    solved: Any = SimpleNamespace(solution=SimpleNamespace(joint_reactions=SimpleNamespace(labels=())))
    axis = Figure().subplots()
    axis.set_title("joint reaction in the plane of the glenoid", loc="left")
    _joint_forces(axis, solved)
    texts = [axis.get_title(loc="left"), *(text.get_text() for text in axis.texts)]
    assert "--joint" in " ".join(texts) and "glenoid" not in " ".join(texts)
