"""Names in an OpenSim file to which other elements refer: bodies, offset frames and coordinates."""

from __future__ import annotations

import posixpath
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.model import Coordinate, Placement
from solver.multibody.rotations import rotation_body_fixed_xyz
from solver.osim.document import Element

Array = NDArray[np.float64]


@dataclass(frozen=True)
class OffsetFrame:
    body: int
    placement: Placement


class Names:
    """Filled while a file is read: frames by their path in the model, coordinates in the model's order."""

    def __init__(self) -> None:
        self.frames: dict[str, OffsetFrame] = {}
        self.coordinates: list[Coordinate] = []

    def add_body(self, path: str, body: int) -> None:
        self.frames[path] = OffsetFrame(body, Placement(np.eye(3), np.zeros(3)))

    def add_offset_frames(self, offsets: list[Element], owner: str) -> None:
        for offset in offsets:
            if offset.tag != "PhysicalOffsetFrame":
                raise offset.unsupported("component", "PhysicalOffsetFrame")
            path = f"{owner}/{offset.name}"
            parent = self.frame(offset, "socket_parent", path)
            rotation = rotation_body_fixed_xyz(offset.numbers("orientation", 3, "0 0 0"))
            translation = offset.numbers("translation", 3, "0 0 0")
            outer = parent.placement
            placement = Placement(outer.rotation @ rotation, outer.translation + outer.rotation @ translation)
            self.frames[path] = OffsetFrame(parent.body, placement)

    def frame(self, element: Element, socket: str, owner: str = "/") -> OffsetFrame:
        """The frame named by a socket of the component at the path `owner`, by an absolute or relative path."""
        name = element.child(socket).text
        path = posixpath.normpath(posixpath.join(owner, name))
        if path not in self.frames:
            raise element.child(socket).refusal(
                f"of {element.tag} {element.name} names an unknown frame {name}", SolverCode.UNKNOWN_NAME
            )
        return self.frames[path]

    def named_frame(self, element: Element, tag: str) -> OffsetFrame:
        """The frame in a property that is a name or path rather than a socket: a body's name, or a frame's path."""
        name = element.child(tag).text
        for path in (posixpath.normpath(posixpath.join("/", name)), f"/bodyset/{name}"):
            if path in self.frames:
                return self.frames[path]
        raise element.refusal(f"names an unknown body {name}", SolverCode.UNKNOWN_NAME)

    def body(self, element: Element, tag: str) -> int:
        """The moving body that a property names."""
        name = element.child(tag).text
        if f"/bodyset/{name}" not in self.frames:
            raise element.refusal(f"names an unknown body {name}", SolverCode.UNKNOWN_NAME)
        return self.frames[f"/bodyset/{name}"].body

    def station(self, element: Element, socket: str, location: str) -> tuple[int, Array]:
        """A point fixed in a frame, given in the body that carries the frame."""
        frame = self.frame(element, socket)
        placement = frame.placement
        return frame.body, placement.translation + placement.rotation @ element.numbers(location, 3, "0 0 0")

    def coordinate(self, element: Element, name: str) -> int:
        name = posixpath.basename(name)
        for index, coordinate in enumerate(self.coordinates):
            if coordinate.name == name:
                return index
        raise element.refusal(f"names an unknown coordinate {name}", SolverCode.UNKNOWN_NAME)
