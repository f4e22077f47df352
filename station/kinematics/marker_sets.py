"""Marker sets by name, or of a lab's own file: which body each marker sits on, and where in the model it goes."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from pydantic import Field

from documents.message import Message
from documents.plain_data import parse_toml, read_toml
from documents.validation import Section, Vector, refused_as
from station.errors import StationError
from station.messages.kinematics_messages import KinematicsCode

if TYPE_CHECKING:
    from solver.model import Marker, Model
    from station.kinematics.marker_checks import Finding


class MarkerSetError(StationError):
    """A marker set that is none, or that the model has no bodies for."""


class MarkerSite(Section):
    """A marker: the body it sits on, its landmark for people, and its place (see marker_sets.toml)."""

    body: str
    landmark: str = ""
    same_as: tuple[str, ...] = ()
    location_m: Vector | None = None


class LabelledMarkers(Section):
    """A marker set; source names where it is published."""

    title: str = ""
    source: str = ""
    markers: dict[str, MarkerSite] = Field(min_length=1)


def published_sets() -> tuple[str, ...]:
    """Names of the sets of marker_sets.toml."""
    return tuple(_published())


def read_marker_set(name: str) -> LabelledMarkers:
    """A set of marker_sets.toml by its name, or of a file that ends in .toml. Raises MarkerSetError."""
    if not name.endswith(".toml"):
        if name not in _published():
            raise MarkerSetError(
                Message(KinematicsCode.UNKNOWN_SET, {"name": name, "known": ", ".join(published_sets())})
            )
        return _published()[name]
    with refused_as(MarkerSetError, Path(name), KinematicsCode.WRONG_SET):
        return LabelledMarkers.model_validate(read_toml(Path(name)))


def place_marker_set(model: Model, name: str) -> tuple[Model, list[str], tuple[Finding, ...]]:
    """The model with the markers of a set, the names of those with a place in it, and findings on the others.

    A marker that the model has on another body than the set stays there. Raises MarkerSetError for an unknown set, and
    if the model has none of its bodies.
    """
    from solver.model import Marker  # the console only lists the names of sets
    from solver.osim.model_writer import with_markers
    from station.kinematics.marker_checks import unattached_findings

    marker_set = read_marker_set(name)
    bodies = {body.name: index for index, body in enumerate(model.bodies)}
    known = {marker.name: marker for marker in model.markers}
    unattached = tuple(label for label, site in marker_set.markers.items() if site.body not in bodies)
    if len(unattached) == len(marker_set.markers):
        first = {"marker": unattached[0], "body": marker_set.markers[unattached[0]].body}
        figures = {"set": name, **first, "model": model.name, "known": ", ".join(bodies)}
        raise MarkerSetError(Message(KinematicsCode.NO_BODY, figures))
    placed: list[Marker] = []
    elsewhere: list[str] = []
    for label, site in marker_set.markers.items():
        if label in unattached:
            continue
        if label in known:
            placed.append(known[label])
            elsewhere += [label] * (known[label].body != bodies[site.body])
            continue
        twin = next((known[other] for other in site.same_as if other in known), None)
        if twin is not None and twin.body == bodies[site.body]:
            placed.append(Marker(label, twin.body, twin.location))
        elif site.location_m is not None:
            placed.append(Marker(label, bodies[site.body], np.array(site.location_m)))
    names = [marker.name for marker in placed]
    without_place = [label for label in marker_set.markers if label not in (*names, *unattached)]
    found = {KinematicsCode.WITHOUT_PLACE: without_place, KinematicsCode.ELSEWHERE: elsewhere}
    findings = tuple(Message(code, {"markers": ", ".join(markers)}) for code, markers in found.items() if markers)
    return with_markers(model, placed), names, unattached_findings(name, unattached) + findings


@cache
def _published() -> dict[str, LabelledMarkers]:
    tables = parse_toml(Path(__file__).with_suffix(".toml").read_bytes())
    return {name: LabelledMarkers.model_validate(table) for name, table in tables.items()}
