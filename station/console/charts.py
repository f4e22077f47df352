"""How the console's curves are lettered: for two metres, on white and on black."""

from __future__ import annotations

from typing import Any

LETTERS = {"fontSize": 16, "color": "#808890"}
LINES = {"lineStyle": {"color": "#80889060"}}
AXIS: dict[str, Any] = {"type": "value", "axisLabel": LETTERS, "nameTextStyle": LETTERS, "splitLine": LINES}
LEGEND: dict[str, Any] = {"top": 0, "textStyle": LETTERS}
