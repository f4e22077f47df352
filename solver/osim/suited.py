"""The suit in an OpenSim document: cuffs as bodies, the cord as a PathSpring, compliance as BushingForce."""

from __future__ import annotations

import re
import xml.etree.ElementTree as Xml

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.errors import SolverCode
from solver.functions.coordinate import polynomial
from solver.model import Coordinate, Model, Placement
from solver.osim.earlier_versions import PRESENT_LAYOUT
from solver.osim.path_writer import add_path, add_path_point
from solver.osim.writer import add_axes, add_body, add_joint
from solver.osim.xml_elements import add, add_values, objects_of
from solver.suit.cord import direction_to_joint
from solver.suit.scenarios import SuitScenario
from solver.suit.suit import PARTS, Suit, SuitError, SuitMass, SuitPoint, ensure_fits
from solver.suit.suited_model import CORD, CUFF_NAMES

Array = NDArray[np.float64]

NO_NAME = r"[\s/\\*+]"  # characters that the name of a component of OpenSim cannot have
REACH = 0.2  # m, either way: the range of a cuff's coordinates; they are not clamped to it


def add_suit(root: Xml.Element, model: Model, suit: Suit, scenario: SuitScenario) -> None:
    """Add the suit, at its last rest length, to the document of `model`; existing elements do not change.

    A cuff is a body with its mass, the cord's end its origin: welded where it is rigid, else free to shift along its
    holder's x, y, z (coordinates waist_cuff_x, …, zero at rest, held by the bushing). Where cuffs slip along the cord,
    their migration lengthens the PathSpring, which leaves the cord's line and its tension; along the bone it moves
    their rest. The cord's points carry the names of the suit's parts. Raises SuitError for a law that OpenSim's forces
    do not have, or for names in use.
    """
    _ensure_can_be_written(root, model, suit, scenario)
    osim = root.find("Model")
    assert osim is not None  # noqa: S101  (the document of a model)
    slips_along_cord = suit.migration_direction == "cord"
    cuffs = dict(zip(("waist", "arm"), scenario.cuffs, strict=True))
    masses = dict(zip(PARTS, suit.masses, strict=True))
    for part in suit.parts:
        point, cuff = getattr(suit, part), cuffs.get(part)
        slipped = cuff.migration if cuff and scenario.is_shifted and not slips_along_cord else 0.0
        rest = point.location + slipped * direction_to_joint(point)
        _add_cuff(osim, part, SuitPoint(point.body, rest), masses[part], cuff if scenario.yields else None)
    spring = add(objects_of(osim, "ForceSet"), "PathSpring", CORD)
    points = add_path(spring)
    for part in suit.parts:
        name = re.sub(NO_NAME, "_", suit.names[part])
        add_path_point(points, f"{CORD}_{name}", f"/bodyset/{part}_cuff", np.zeros(3))
    slack = scenario.migration if slips_along_cord else 0.0
    length = float(scenario.rest_lengths[-1]) + slack
    add_values(spring, resting_length=length, stiffness=suit.stiffness, dissipation=0.0)


def _ensure_can_be_written(root: Xml.Element, model: Model, suit: Suit, scenario: SuitScenario) -> None:
    ensure_fits(suit, model)
    if int(root.get("Version", "0")) < PRESENT_LAYOUT:
        raise SuitError(
            f"the model has the layout of OpenSim {root.get('Version', '0')[:1]}, and the suit is added in that of "
            "OpenSim 4; open the model in OpenSim 4 and save it",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    if root.find(".//*[@file]") is not None:
        raise SuitError(
            "the model takes parts from other files, which the suit cannot be added to; open the model in OpenSim and "
            "save it as one file",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    if suit.damping:
        raise SuitError(
            f"the suit's cord should have no damping to become a PathSpring, whose dissipation grows with the stretch, "
            f"and has {suit.damping:g} N s/m; set exotendon.damping_n_s_per_m to 0 for the export",
            SolverCode.SUIT_NOT_WRITABLE,
        )
    _ensure_masses_of_cuffs(suit, scenario)
    taken = {element.get("name") for element in root.iter()} & {CORD, *CUFF_NAMES}
    if taken:
        raise SuitError(
            f"the model {model.name} should not wear a suit yet and has {', '.join(sorted(map(str, taken)))}; take the "
            "bare model",
            SolverCode.SUIT_NOT_WRITABLE,
        )


def _ensure_masses_of_cuffs(suit: Suit, scenario: SuitScenario) -> None:
    """Raise SuitError unless each mass can be that of a cuff; OpenSim cannot move a cuff without mass on a bushing."""
    yielding = {part for part, cuff in zip(("waist", "arm"), scenario.cuffs, strict=True) if cuff and scenario.yields}
    for part, mass in zip(PARTS, suit.masses, strict=True):
        problem = ""
        if part not in suit.parts:
            problem = f"0 kg beside a straight cord and is {mass.mass:g} kg; move it to a cuff" if mass.mass else ""
        elif mass.body != getattr(suit, part).body:
            body = getattr(suit, part).body
            problem = f"on the body of exotendon.{part}, {body}, to become one cuff and is on {mass.body}; move it"
        elif part in yielding and not mass.mass:
            problem = "above 0 kg, because OpenSim cannot move a yielding cuff without mass; add it, or export it rigid"
        if problem:
            raise SuitError(f"the suit's masses.{part} should be {problem}", SolverCode.SUIT_NOT_WRITABLE)


def _add_cuff(osim: Xml.Element, part: str, rest: SuitPoint, mass: SuitMass, yields: CuffParameters | None) -> None:
    name, holder = f"{part}_cuff", f"/bodyset/{rest.body}"
    center = mass.center - rest.location
    add_body(objects_of(osim, "BodySet"), name, mass.mass, center, np.diag(mass.inertia))
    sides = [
        (holder, Placement(np.eye(3), rest.location)),
        (f"/bodyset/{name}", Placement(np.eye(3), np.zeros(3))),
    ]
    joints = objects_of(osim, "JointSet")
    if yields is None:
        add_joint(joints, "WeldJoint", f"{name}_joint", sides, [])
        return
    shifts = [f"{name}_{axis}" for axis in "xyz"]
    coordinates = [Coordinate(shift, "translation", 0.0, (-REACH, REACH)) for shift in shifts]
    joint = add_joint(joints, "CustomJoint", f"{name}_joint", sides, coordinates)
    functions = [polynomial([0.0])] * 3 + [polynomial([0.0, 1.0])] * 3
    add_axes(joint, np.vstack([np.eye(3), np.eye(3)]), ["", "", "", *shifts], functions)
    add_values(
        add(objects_of(osim, "ForceSet"), "BushingForce", f"{name}_bushing"),
        socket_frame1=f"/jointset/{name}_joint/{name}_joint_{rest.body}",
        socket_frame2=f"/bodyset/{name}",
        rotational_stiffness=np.zeros(3),
        translational_stiffness=np.full(3, yields.stiffness),
        rotational_damping=np.zeros(3),
        translational_damping=np.full(3, yields.damping),
    )
