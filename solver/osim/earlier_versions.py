"""Models of OpenSim 2 and 3 in the layout of OpenSim 4, so that one reader serves all versions.

Up to version 3.3 a <Body> holds the joint that connects it to its parent, the joint holds the placements of its two
frames, the ground is one of the bodies, and components refer to bodies by name. OpenSim 4 lists joints beside bodies
and refers to frames by path. The rules here are those by which OpenSim 4.6 opens an earlier file; the oracle tests
compare both. OpenSim rounds moments of inertia and the frames of joints to six digits when it converts them. The
rounding is kept, so that both programs solve the same model.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from solver.errors import SolverCode
from solver.osim.document import TRUE, Element

GROUND_NAME = "ground"
GROUND_PATH = "/ground"


OPENSIM_2, AFTER_OPENSIM_3, PRESENT_LAYOUT, AFTER_OPENSIM_4, LONGEST_VERSION = 20000, 30500, 30517, 50000, 9


def is_earlier(document: Element) -> bool:
    """Whether OpenSim 2 or 3 wrote the document."""
    version = document.attributes.get("Version", "")
    number = int(version) if version.isdecimal() and len(version) <= LONGEST_VERSION else 0
    is_development_version = AFTER_OPENSIM_3 <= number < PRESENT_LAYOUT
    if not OPENSIM_2 <= number < AFTER_OPENSIM_4 or is_development_version:
        advice = (
            'open the model in OpenSim 4 and save it, or in Python: opensim.Model("old.osim").printToXML("new.osim")'
        )
        if is_development_version:
            advice = "OpenSim 4.6 does not open most models of these development versions; save it with a released one"
        raise document.refusal(
            f"has the version {version[:LONGEST_VERSION] or 'none'}, expected one of OpenSim 2, 3 or 4; {advice}",
            SolverCode.WRONG_DOCUMENT,
        )
    return number < PRESENT_LAYOUT


def force_set_as_version_4(force_set: Element) -> Element:
    """A <ForceSet> of an OpenSim 2 or 3 document as one of OpenSim 4."""
    return _upgraded(force_set)


def as_version_4(model: Element) -> Element:
    """The <Model> of an OpenSim 2 or 3 document as one of OpenSim 4. Raises ModelError for a body without its joint."""
    model = _upgraded(model)
    bodies = model.objects("BodySet")
    moving = [body for body in bodies if body.name != GROUND_NAME]
    ground = next((replace(body, tag="Ground") for body in bodies if body.name == GROUND_NAME), None)
    parts = [
        ground or _element(model, "Ground"),
        _set(model, "BodySet", moving),
        _set(model, "JointSet", [_joint(body) for body in moving]),
        *(child for child in model.children if child.tag != "BodySet"),
    ]
    return replace(model, children=parts)


def _upgraded(element: Element) -> Element:
    """The element and those within it, each with the properties of its class in OpenSim 4."""
    element = replace(element, children=[_upgraded(child) for child in element.children])
    element = replace(element, tag=_TAGS.get(element.tag, element.tag))
    if element.find("isDisabled") is not None:
        kinds = {"Constraint": "isEnforced", "Controller": "enabled"}
        switch = next((switch for kind, switch in kinds.items() if element.tag.endswith(kind)), "appliesForce")
        element = _with(element, "isDisabled", _switch(switch))
    if element.tag == "Body":
        return _body(element)
    if element.tag == "TransformAxis":
        return _unwrapped(element, "function")
    if element.find("max_isometric_force") is not None:
        element = _muscle(element)
    if element.tag in _TWO_FRAMES:
        element = _two_frames(element)
    for old, new in _BODY_REFERENCES.get(element.tag, {}).items():
        element = _with(element, old, _reference(new))
    for old, new in _COORDINATE_REFERENCES.get(element.tag, {}).items():
        element = _with(element, old, partial(replace, tag=new))
    return element


_TAGS = {  # classes that were renamed
    "NaturalCubicSpline": "SimmSpline",
    "natCubicSpline": "SimmSpline",
    "ActuatorSet": "ForceSet",
    "GeneralizedForce": "CoordinateActuator",
    "Force": "PointActuator",
    "Torque": "TorqueActuator",
    "Schutte1993Muscle": "Schutte1993Muscle_Deprecated",
    "MusclePointSet": "PathPointSet",
    "MusclePoint": "PathPoint",
    "MuscleViaPoint": "ConditionalPathPoint",
    "MovingMusclePoint": "MovingPathPoint",
    "MuscleWrapSet": "PathWrapSet",
    "MuscleWrap": "PathWrap",
}
_POINT, _PAIR = {"body": "socket_parent_frame"}, {"body_1": "socket_body_1", "body_2": "socket_body_2"}
_BODY_REFERENCES = {
    "PathPoint": _POINT,
    "ConditionalPathPoint": _POINT,
    "MovingPathPoint": _POINT,
    "Marker": _POINT,
    "PointConstraint": _PAIR,
    "PointToPointSpring": {"body1": "socket_body1", "body2": "socket_body2"},
    "PrescribedForce": {"body": "socket_frame"},
    "ConstantDistanceConstraint": _PAIR,
    "PointOnLineConstraint": {"line_body": "socket_line_body", "follower_body": "socket_follower_body"},
    "ContactSphere": {"body_name": "socket_frame"},
    "ContactHalfSpace": {"body_name": "socket_frame"},
}
_TWO_FRAMES = ("BushingForce", "FunctionBasedBushingForce", "ExpressionBasedBushingForce", "WeldConstraint")
_COORDINATE_REFERENCES = {
    "ConditionalPathPoint": {"coordinate": "socket_coordinate", "coordinates": "socket_coordinate"},
    "MovingPathPoint": {f"{axis}_coordinate": f"socket_{axis}_coordinate" for axis in "xyz"},
}


def _with(element: Element, tag: str, change: Callable[[Element], Element]) -> Element:
    """The element with its child of that tag changed."""
    return replace(element, children=[change(child) if child.tag == tag else child for child in element.children])


def _reference(tag: str) -> Callable[[Element], Element]:
    return lambda found: _element(found, tag, text=_path(found.text))


def _switch(tag: str) -> Callable[[Element], Element]:
    return lambda found: _element(found, tag, text="false" if found.text.lower() in TRUE else "true")


def _rounded(element: Element) -> Element:
    """To six significant digits."""
    return replace(element, pieces=[" ".join(f"{value:.6g}" for value in element.values())])


def _path(body: str) -> str:
    return GROUND_PATH if body == GROUND_NAME else f"/bodyset/{body}"


def _unwrapped(element: Element, tag: str) -> Element:
    """The element with the content of its property in the place of the property."""
    children: list[Element] = []
    for child in element.children:
        children += child.children if child.tag == tag else [child]
    return replace(element, children=children)


def _body(element: Element) -> Element:
    """Moments and products of inertia are one property."""
    if element.find("inertia_xx") is None:
        return element
    tags = [f"inertia_{axes}" for axes in ("xx", "yy", "zz", "xy", "xz", "yz")]
    inertia = _rounded(_element(element, "inertia", text=" ".join(element.word(tag, "0") for tag in tags)))
    kept = [child for child in element.children if child.tag not in tags]
    return replace(element, children=[*kept, inertia])


def _muscle(element: Element) -> Element:
    """The path is a property, and the pennation has its present name."""
    element = _with(element, "pennation_angle", partial(replace, tag="pennation_angle_at_optimal"))
    path = [child for child in element.children if child.tag in ("PathPointSet", "PathWrapSet")]
    if element.find("GeometryPath") is not None or not path:
        return element
    kept = [child for child in element.children if child not in path]
    return replace(element, children=[*kept, _element(element, "GeometryPath", children=path)])


def _joint(body: Element) -> Element:
    """The joint of a body, with its frames as offsets from the two bodies."""
    held = body.members("Joint")
    if len(held) != 1:
        raise body.refusal(f"has {len(held)} joints, expected one in its <Joint>")
    joint = held[0]
    parent = joint.child("parent_body").text
    frames = [
        _offset(joint, f"{parent}_offset", parent, "location_in_parent", "orientation_in_parent"),
        _offset(joint, f"{body.name}_offset", body.name, "location", "orientation"),
    ]
    sockets = ["socket_parent_frame", "socket_child_frame"]
    if joint.flag("reverse"):
        sockets.reverse()
    ends = [_element(joint, tag, text=frame.name) for tag, frame in zip(sockets, frames, strict=True)]
    coordinates = _element(joint, "coordinates", children=joint.objects("CoordinateSet"))
    kept = [child for child in joint.children if child.tag not in _JOINT_LAYOUT]
    name = joint.name or f"{body.name}_joint"
    return replace(
        joint,
        attributes={"name": name},
        children=[*ends, _element(joint, "frames", children=frames), coordinates, *kept],
    )


_JOINT_LAYOUT = (
    "parent_body",
    "location_in_parent",
    "orientation_in_parent",
    "location",
    "orientation",
    "CoordinateSet",
    "reverse",
)


def _two_frames(element: Element) -> Element:
    """A component between two bodies as one between offset frames."""
    bodies = [element.word(f"body_{number}", GROUND_NAME) for number in (1, 2)]
    frames = [
        _offset(element, f"{number}_{body}_offset", body, f"location_body_{number}", f"orientation_body_{number}")
        for number, body in enumerate(bodies, start=1)
    ]
    sockets = [_element(element, f"socket_frame{number}", text=frame.name) for number, frame in enumerate(frames, 1)]
    return replace(element, children=[*element.children, _element(element, "frames", children=frames), *sockets])


def _offset(joint: Element, name: str, body: str, location: str, orientation: str) -> Element:
    children = [
        _element(joint, "socket_parent", text=_path(body)),
        _rounded(_element(joint, "translation", text=joint.word(location, "0 0 0"))),
        _rounded(_element(joint, "orientation", text=joint.word(orientation, "0 0 0"))),
    ]
    return replace(_element(joint, "PhysicalOffsetFrame", children=children), attributes={"name": name})


def _set(model: Element, tag: str, objects: list[Element]) -> Element:
    return _element(model, tag, children=[_element(model, "objects", children=objects)])


def _element(place: Element, tag: str, *, text: str = "", children: list[Element] | None = None) -> Element:
    """A new element; a refusal names the line of the one that it replaces."""
    return Element(place.file, place.line, tag, {}, children or [], [text])
