"""How the console's curves are lettered: for two metres, in the colour of the axis they belong to.

Drawn for a white page; on a black one the browser turns the whole picture round (`page.STYLE`).
"""

from __future__ import annotations

from typing import Any

INK, FORCE, DISPLACEMENT = "#2c3640", "#0b4f9e", "#a83a00"
DISPLACEMENT_AXIS, FORCE_AXIS, TIME_AXIS = "displacement [mm]", "force [N]", "time from the sync edge [s]"
LINE_WIDTH = 3


def axis(name: str = "", colour: str = INK, **more: Any) -> dict[str, Any]:
    """A value axis that follows its curve, at the edge of the picture, with ticks that stay apart in a low one."""
    letters = {"fontSize": 18, "color": colour}
    return {
        "type": "value",
        "scale": True,
        "name": name,
        "splitNumber": 3,
        "axisLine": {"onZero": False},
        "axisLabel": letters,
        "nameTextStyle": letters,
        "splitLine": {"lineStyle": {"color": "#80889060"}},
        **more,
    }


def axis_below(name: str, **more: Any) -> dict[str, Any]:
    """The axis along the bottom: its numbers clear of the lowest one beside it, its name under them."""
    letters = {"fontSize": 18, "color": INK}
    return axis(name, nameLocation="middle", nameGap=36, axisLabel={**letters, "margin": 14}, **more)


def line(colour: str = FORCE, **more: Any) -> dict[str, Any]:
    style = {"width": LINE_WIDTH, "color": colour}
    return {"type": "line", "showSymbol": False, "color": colour, "lineStyle": style, "data": [], **more}


def force_over_displacement(path: list[list[float]]) -> dict[str, Any]:
    """The picture of path, (displacement mm, force N) each."""
    return {
        "animation": False,
        "grid": {"left": 60, "right": 20, "top": 40, "bottom": 60},
        "xAxis": axis_below(DISPLACEMENT_AXIS, splitNumber=4),
        "yAxis": axis(FORCE_AXIS),
        "series": [line(data=path)],
    }
