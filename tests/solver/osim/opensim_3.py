"""A model in the layout of OpenSim 3: a child before its parent, every kind of path point, a coupler, a spring."""

from __future__ import annotations


def _body(name: str, joint: str, wrap: str = "") -> str:
    return f"""<Body name="{name}">
<mass>1.3</mass><mass_center>0.02 -0.11 0.03</mass_center>
<inertia_xx>0.0212345678</inertia_xx><inertia_yy>0.015</inertia_yy><inertia_zz>0.018</inertia_zz>
<inertia_xy>0.001</inertia_xy><inertia_xz>-0.002</inertia_xz><inertia_yz>0.0015</inertia_yz>
<Joint>{joint}</Joint><WrapObjectSet><objects>{wrap}</objects></WrapObjectSet></Body>"""


def _placed(parent: str, coordinates: str) -> str:
    return f"""<parent_body>{parent}</parent_body>
<location_in_parent>0.123456789 0.2 -0.1</location_in_parent><orientation_in_parent>0.3 -0.4 0.5</orientation_in_parent>
<location>0.02 0.05 0.01</location><orientation>-0.2 0.1 0.6</orientation>
<CoordinateSet><objects>{coordinates}</objects></CoordinateSet><reverse>false</reverse>"""


def _axis(name: str, axis: str, coordinate: str, function: str) -> str:
    return f"""<TransformAxis name="{name}"><coordinates>{coordinate}</coordinates><axis>{axis}</axis>
<function>{function}</function></TransformAxis>"""


_SPLINE = "<NaturalCubicSpline><x>-1.123456789 0 0.5 1.5</x><y>0.01 0.0212345678 0.04 -0.03</y></NaturalCubicSpline>"
_LINE, _ZERO = (
    "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>",
    "<Constant><value>0</value></Constant>",
)
_CLAMPED = '<Coordinate name="a"><range>-2 2</range><clamped>true</clamped></Coordinate>'
_CUSTOM = f"""<CustomJoint name="first"><SpatialTransform>
{_axis("rotation1", "0 0 1", "a", _LINE)}{_axis("rotation2", "0 1 0", "", _ZERO)}
{_axis("rotation3", "1 0 0", "", _ZERO)}{_axis("translation1", "1 0 0", "a", _SPLINE)}
{_axis("translation2", "0 1 0", "b", _LINE)}{_axis("translation3", "0 0 1", "", _ZERO)}</SpatialTransform>
{_placed("ground", _CLAMPED + '<Coordinate name="b"/>')}</CustomJoint>"""
_BENT = '<Coordinate name="c"><default_value>0.3</default_value></Coordinate>'
_PIN = f'<PinJoint name="second">{_placed("upper", _BENT)}</PinJoint>'
_WRAP = """<WrapCylinder name="bone"><xyz_body_rotation>0.1 0.2 0.3</xyz_body_rotation>
<translation>0.01 -0.1 0.02</translation><quadrant>all</quadrant>
<radius>0.03</radius><length>0.4</length></WrapCylinder>"""
_MOVING = "".join(
    f"<{axis}_location>{_SPLINE}</{axis}_location><{axis}_coordinate>c</{axis}_coordinate>" for axis in "xyz"
)
_MUSCLE = f"""<Thelen2003Muscle name="pull"><isDisabled>false</isDisabled><GeometryPath>
<PathPointSet><objects>
<PathPoint name="p1"><location>0.05 0.1 0.02</location><body>ground</body></PathPoint>
<ConditionalPathPoint name="p2"><location>0.1 -0.1 0.04</location><body>upper</body><range>-9 0.2</range>
<coordinate>a</coordinate></ConditionalPathPoint>
<MovingPathPoint name="p3"><location>0 0 0</location><body>upper</body>{_MOVING}</MovingPathPoint>
<PathPoint name="p4"><location>0.02 -0.2 0</location><body>lower</body></PathPoint>
</objects></PathPointSet>
<PathWrapSet><objects><PathWrap name="w"><wrap_object>bone</wrap_object></PathWrap></objects></PathWrapSet>
</GeometryPath><max_isometric_force>200</max_isometric_force><optimal_fiber_length>0.2</optimal_fiber_length>
<tendon_slack_length>0.15</tendon_slack_length><{{pennation}}>0.1</{{pennation}}></Thelen2003Muscle>"""
_COUPLER = f"""<CoordinateCouplerConstraint name="couple"><isDisabled>false</isDisabled>
<coupled_coordinates_function>{_SPLINE}</coupled_coordinates_function>
<independent_coordinate_names>c</independent_coordinate_names>
<dependent_coordinate_name>b</dependent_coordinate_name></CoordinateCouplerConstraint>"""


def opensim_3_document(version: int = 30000, pennation: str = "pennation_angle_at_optimal") -> str:
    return f"""<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="{version}"><Model name="earlier"><gravity>0.5 -9.7 0.3</gravity>
<BodySet><objects><Body name="ground"><mass>0</mass><mass_center>0 0 0</mass_center><Joint/></Body>
{_body("lower", _PIN)}{_body("upper", _CUSTOM, _WRAP)}</objects></BodySet>
<ConstraintSet><objects>{_COUPLER}</objects></ConstraintSet>
<ForceSet><objects>{_MUSCLE.format(pennation=pennation)}</objects></ForceSet>
<MarkerSet><objects><Marker name="m"><body>upper</body><location>0.1 0.2 0.3</location></Marker></objects></MarkerSet>
</Model></OpenSimDocument>"""
