from __future__ import annotations

from typing import Any

import pytest

from station.console.charts import ELEVATION_AXIS, force_over_motion
from station.console.running_view import _over_time, has_motion
from station.protocol import TrialSpec

CHARTS = pytest.mark.parametrize(
    "chart", [force_over_motion([]), _over_time(), _over_time(ELEVATION_AXIS)], ids=["path", "over time", "wearer"]
)


@CHARTS
def test_labels_of_the_horizontal_axis_never_run_into_each_other(chart: dict[str, Any]) -> None:
    assert chart["xAxis"]["axisLabel"]["hideOverlap"]


@CHARTS
def test_every_axis_of_a_chart_has_a_name_with_its_unit(chart: dict[str, Any]) -> None:
    beside = chart["yAxis"] if isinstance(chart["yAxis"], list) else [chart["yAxis"]]
    for axis in (chart["xAxis"], *beside):
        assert axis["name"].endswith(("[s]", "[N]", "[mm]", "[deg]"))


def test_a_trial_without_a_motion_has_the_force_alone() -> None:
    chart = _over_time(None)
    assert [len(chart[part]) for part in ("yAxis", "series")] == [1, 1]
    assert not has_motion(TrialSpec(None, "bounce", 1))
    assert has_motion(TrialSpec("hand", "static", 1)) and has_motion(TrialSpec(None, "motion", 1, condition="tight"))
