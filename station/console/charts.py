"""Style of the console's charts: legible from two metres, curves in the colour of their axis.

Drawn for a light page; on a dark one the browser inverts the whole chart (style.css).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

INK, FORCE, DISPLACEMENT = "#2c3640", "#0b4f9e", "#a83a00"
DISPLACEMENT_AXIS, FORCE_AXIS, TIME_AXIS = "displacement [mm]", "force [N]", "time from the sync edge [s]"
ELEVATION_AXIS, EMG_AXIS, EMG_OF_MVC_AXIS = "elevation [deg]", "EMG RMS [\u00b5V]", "EMG RMS [% of the MVC]"
EMG_COLOURS = (FORCE, DISPLACEMENT, "#1b7f3b", "#7a3f9d", INK, "#8a6d00")
LINE_WIDTH = 3


def axis(name: str = "", colour: str = INK, **more: Any) -> dict[str, Any]:
    """A value axis that scales with its curve, at the edge of the chart, with few ticks for low charts."""
    label = {"fontSize": 18, "color": colour}
    return {
        "type": "value",
        "scale": True,
        "name": name,
        "splitNumber": 3,
        "axisLine": {"onZero": False},
        "axisLabel": label,
        "nameTextStyle": label,
        "splitLine": {"lineStyle": {"color": "#80889060"}},
        **more,
    }


def axis_below(name: str, **more: Any) -> dict[str, Any]:
    """The horizontal axis: labels clear of those of the vertical axis, the name below them.

    On a narrow chart, labels that do not fit are left out.
    """
    label = {"fontSize": 18, "color": INK}
    labels = {**label, "margin": 14, "hideOverlap": True}
    return axis(name, nameLocation="middle", nameGap=36, axisLabel=labels, **more)


def line(colour: str = FORCE, **more: Any) -> dict[str, Any]:
    style = {"width": LINE_WIDTH, "color": colour}
    return {"type": "line", "showSymbol": False, "color": colour, "lineStyle": style, "data": [], **more}


def emg_lines(curves: Mapping[str, list[tuple[float, float]]]) -> list[dict[str, Any]]:
    """Series of the EMG over time, one for each channel."""
    return [
        line(EMG_COLOURS[number % len(EMG_COLOURS)], name=channel, data=points)
        for number, (channel, points) in enumerate(curves.items())
    ]


def zoomed_by_wheel(**axes: Any) -> dict[str, Any]:
    """Wheel and drag move and scale the axes; a double click shows all again (freshness.js)."""
    return {"type": "inside", "filterMode": "none", **axes}


def marks_at(marks: Mapping[int, float], names: Mapping[int, str]) -> dict[str, Any]:
    """Vertical lines at the marks of the operator, number → time [s], with their names."""
    lines = [
        {"xAxis": round(at, 3), "name": f"{number} {names.get(number, '')}".strip()} for number, at in marks.items()
    ]
    label = {"formatter": "{b}", "fontSize": 16, "color": INK, "position": "insideEndTop", "width": 110}
    label |= {"overflow": "truncate"}
    return {"symbol": "none", "animation": False, "label": label, "lineStyle": {"color": INK}, "data": lines}


def force_over_motion(path: list[list[float]], motion: str = DISPLACEMENT_AXIS) -> dict[str, Any]:
    """Chart of a path of points (displacement mm or elevation deg, force N); motion is the name of that axis."""
    return {
        "animation": False,
        "grid": {"left": 60, "right": 20, "top": 40, "bottom": 60},
        "xAxis": axis_below(motion, splitNumber=4),
        "yAxis": axis(FORCE_AXIS),
        "dataZoom": [zoomed_by_wheel(xAxisIndex=0), zoomed_by_wheel(yAxisIndex=0)],
        "series": [line(data=path)],
    }
