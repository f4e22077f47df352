from __future__ import annotations

from typing import Any

import pytest

from station.console.charts import ELEVATION_AXIS, force_over_motion
from station.console.running_view import _over_time

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
