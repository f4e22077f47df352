"""Forces of an .osim file that cannot be read: one sentence with element and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from solver.errors import SolverCode
from solver.osim.reader import read_osim
from tests.solver.osim.test_reader import DOOR
from tests.solver.refusals import raises_refusal

LEAF = "<socket_body>/bodyset/leaf</socket_body>"
ENDS = "<bodyA>leaf</bodyA><bodyB>ground</bodyB>"
UNREADABLE = [
    ("<PointActuator name='f'/>", SolverCode.MALFORMED, "PointActuator f has no <body>"),
    ("<PointActuator name='f'><body>wall</body></PointActuator>", SolverCode.UNKNOWN_NAME, "unknown body wall"),
    (
        "<PointActuator name='f'><body>leaf</body><direction>0 0 0</direction></PointActuator>",
        SolverCode.MALFORMED,
        "PointActuator f has a <direction> without length",
    ),
    (
        "<PointActuator name='f'><body>leaf</body><point_is_global>yes</point_is_global></PointActuator>",
        SolverCode.MALFORMED,
        "true or false for <point_is_global>",
    ),
    (f"<TorqueActuator name='f'>{ENDS}<axis>0 0</axis></TorqueActuator>", SolverCode.MALFORMED, "axis"),
    (
        f"<TorqueActuator name='f'>{ENDS}<optimal_force>nan</optimal_force></TorqueActuator>",
        SolverCode.MALFORMED,
        "optimal_force",
    ),
    (
        f"<TorqueActuator name='f'>{ENDS}<min_control>1</min_control><max_control>0</max_control></TorqueActuator>",
        SolverCode.MALFORMED,
        "min_control of 1",
    ),
    (
        "<PointToPointActuator name='f'><bodyA>leaf</bodyA><bodyB>leaf</bodyB></PointToPointActuator>",
        SolverCode.MALFORMED,
        "two points of the same body",
    ),
    (
        "<BodyActuator name='f'><socket_body>/bodyset/wall</socket_body></BodyActuator>",
        SolverCode.UNKNOWN_NAME,
        "/bodyset/wall",
    ),
    ("<PathActuator name='f'/>", SolverCode.MALFORMED, "PathActuator f has no <GeometryPath>"),
]


@pytest.mark.parametrize(
    ("written", "code", "naming"), UNREADABLE, ids=[f"{row[0][:40]} {row[2]}" for row in UNREADABLE]
)
def test_a_force_that_cannot_be_read_is_refused_with_its_line(
    written: str, code: SolverCode, naming: str, tmp_path: Path
) -> None:
    text = DOOR.replace("</objects></ForceSet>", f"{written}\n</objects></ForceSet>")
    file = tmp_path / "door.osim"
    file.write_text(text, encoding="utf-8")
    line = 1 + text[: text.index(written)].count("\n")
    with raises_refusal(code, naming=naming) as caught:
        read_osim(file)
    assert f"door.osim, line {line}: " in str(caught.value)
