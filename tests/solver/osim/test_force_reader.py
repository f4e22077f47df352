"""Forces of an .osim file that cannot be read: one sentence with element and line."""

from __future__ import annotations

from pathlib import Path

import pytest

from solver.errors import SolverCode
from solver.osim.model_reader import read_osim
from tests.refusals import raises_refusal
from tests.solver.osim.test_model_reader import DOOR

BOTH = "<socket_body1>/bodyset/leaf</socket_body1><socket_body2>/bodyset/leaf</socket_body2>"
ENDS = "<bodyA>leaf</bodyA><bodyB>ground</bodyB>"
POINT = "<PathPoint name='p'><socket_parent_frame>/ground</socket_parent_frame></PathPoint>"
PATH = f"<GeometryPath><PathPointSet><objects>{POINT}{POINT}</objects></PathPointSet></GeometryPath>"
MILLARD = "Millard2012EquilibriumMuscle"
UNREADABLE = [
    (
        f"<{MILLARD} name='f'>{PATH}<ForceVelocityCurve><isometric_slope>0.5</isometric_slope></ForceVelocityCurve>"
        f"</{MILLARD}>",
        SolverCode.WRONG_MUSCLE,
        "f should have <isometric_slope> in (1.09722, inf) and has 0.5",
    ),
    (
        f"<Thelen2003Muscle name='f'>{PATH}<fv_linear_extrap_threshold>0.5</fv_linear_extrap_threshold>"
        "</Thelen2003Muscle>",
        SolverCode.WRONG_MUSCLE,
        "f should have <fv_linear_extrap_threshold> in (0.714286, 1) and has 0.5",
    ),
    (
        "<PathActuator name='f'>" + PATH.replace(POINT, "", 1) + "</PathActuator>",
        SolverCode.WRONG_PATH,
        "GeometryPath has 1 points, expected at least 2",
    ),
    (
        "<PathActuator name='f'><FunctionBasedPath/></PathActuator>",
        SolverCode.UNSUPPORTED,
        "PathActuator f has a FunctionBasedPath",
    ),
    (f"<{MILLARD} name='f'><FunctionBasedPath/></{MILLARD}>", SolverCode.UNSUPPORTED, "f has a FunctionBasedPath"),
    ("<PathSpring name='f'><FunctionBasedPath/></PathSpring>", SolverCode.UNSUPPORTED, "f has a FunctionBasedPath"),
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
        f"<TorqueActuator name='f'>{ENDS}<optimal_force>0</optimal_force></TorqueActuator>",
        SolverCode.NOT_POSITIVE,
        "TorqueActuator f has an <optimal_force> of 0",
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
    ("<PathSpring name='f'/>", SolverCode.MALFORMED, "PathSpring f has no <GeometryPath>"),
    (
        "<PathSpring name='f'>" + PATH + "<resting_length>-1</resting_length></PathSpring>",
        SolverCode.NOT_POSITIVE,
        "<resting_length> of 0 or above",
    ),
    (
        "<Blankevoort1991Ligament name='f'>" + PATH + "</Blankevoort1991Ligament>",
        SolverCode.NOT_POSITIVE,
        "slack_length",
    ),
    (
        f"<PointToPointSpring name='f'>{BOTH}</PointToPointSpring>",
        SolverCode.MALFORMED,
        "two points of the same body",
    ),
    (
        "<CoordinateLimitForce name='f'><coordinate>angle</coordinate><transition>0</transition>"
        "</CoordinateLimitForce>",
        SolverCode.NOT_POSITIVE,
        "transition",
    ),
    (
        "<PrescribedForce name='f'><socket_frame>/bodyset/leaf</socket_frame><FunctionSet name='forceFunctions'>"
        "<objects><Constant/><Sine/><Constant/></objects></FunctionSet></PrescribedForce>",
        SolverCode.UNSUPPORTED,
        "Sine makes PrescribedForce f depend on time",
    ),
    *(
        (
            f"<ExpressionBasedCoordinateForce name='f'><coordinate>angle</coordinate><expression>{formula}</expression>"
            "</ExpressionBasedCoordinateForce>",
            SolverCode.MALFORMED,
            f"expression of ExpressionBasedCoordinateForce f {complaint}",
        )
        for formula, complaint in (
            ("2*width", "has the unknown variable width, expected q, qdot"),
            ("2*", "has '2*', which is not arithmetic"),
            ("q**2", "has 'q**2', which is not arithmetic"),
            ("__import__('os').system('ls')", "has '__import__('os').system('ls')', which is not arithmetic"),
            ("floor(q)", "has the unknown function floor of 1 arguments"),
            ("sin(q,q)", "has the unknown function sin of 2 arguments"),
            ("q if q else 1", "has"),
            ("a*q; a", "has the definition 'a', expected name=formula"),
            ("(" * 300 + "q" + ")" * 300, "has"),
            ("-" * 300 + "q", "is nested more than"),
            ("q" * 6000, "is longer than"),
            ("'a'", "has"),
            ("True*q", "has 'True', which is not arithmetic"),
        )
    ),
    ("<PathActuator name='f'/>", SolverCode.MALFORMED, "PathActuator f has no <GeometryPath>"),
]


@pytest.mark.parametrize(("written", "code", "naming"), UNREADABLE, ids=[row[2][:60] for row in UNREADABLE])
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
