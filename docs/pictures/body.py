"""Draw a scaled body beside the generic one: `python -m docs.pictures.body generic.osim person.osim`.

Front and right side, each model in its assembled default posture with an upright thorax, both with the jugular notch at
the same place. body.png in the documentation is of the patient of docs/motion.md; thoracoscapular model of Seth et al.
(2019), CC BY 4.0.
"""

from __future__ import annotations

import io
import sys
from collections.abc import Callable
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from solver.inverse_kinematics.solve import assemble
from solver.model import GROUND, Model, PathPoint, PointConstraint, WrapSurface
from solver.multibody.postures import Postures, points_in_ground, postures
from solver.osim.model_reader import read_osim
from station.report.plot import FORCE, LINE, MOTION, STYLE

Array = NDArray[np.float64]

HERE = Path(__file__).parent
View = tuple[int, int, float]
VIEWS: dict[str, View] = {"from the front": (2, 1, -1.0), "from the right": (0, 1, 1.0)}
"""Title → axes of the ground (x forward, y up, z right) that point right and up, and the sign of the first."""
BONES = ("clavicle", "humerus", "ulna", "radius", "hand")
CM = 100.0
COLOURS = 128


@mpl.rc_context(STYLE)
def draw_body(generic: Model, person: Model) -> None:
    """body.png: bones as lines between joints, the outline of the scapula's muscle attachments, the ellipsoid of the
    thorax, muscles, and markers.
    """
    figure = Figure(figsize=(9.0, 6.0), layout="constrained")
    for axes, (title, view) in zip(figure.subplots(1, 2, width_ratios=[1.5, 1]), VIEWS.items(), strict=True):
        for model, colour, label in ((generic, MOTION, "generic"), (person, FORCE, "person")):
            _draw_model(axes, model, view, colour, label)
        axes.set_aspect("equal")
        axes.set(title=title, xlabel="cm", ylabel="cm")
        axes.legend(loc="lower left" if view[0] == 0 else "lower right")
    save_picture(figure, "body.png")


def _draw_model(axes: Axes, model: Model, view: View, colour: str, label: str) -> None:
    at = _upright(model)
    state = postures(model, at, np.zeros_like(at))
    draw_bones(axes, model, state, view, colour, label)
    flat = flattened(model, state, view)
    for muscle in model.muscles:
        fixed = [point for point in muscle.path.points if isinstance(point, PathPoint)]
        points = np.concatenate([points_in_ground(state, point.body, point.location) for point in fixed])
        axes.plot(*flat(points).T, color=colour, linewidth=0.5, alpha=0.35)
    places = [points_in_ground(state, marker.body, marker.location)[0] for marker in model.markers]
    axes.scatter(*flat(np.array(places)).T, s=14, facecolors="none", edgecolors=colour, linewidths=0.9)
    axes.axhline(0.0, color=LINE, linewidth=0.4)


def flattened(model: Model, state: Postures, view: View) -> Callable[[Array], Array]:
    """Points (points, 3) [m] in ground → (points, 2) [cm] in a view, from the jugular notch."""
    notch = state.origin_in_ground[0, model.body_index("thorax")]
    right, up, sign = view

    def flat(points: Array) -> Array:
        shown = CM * (np.atleast_2d(points) - notch)
        return np.column_stack([sign * shown[:, right], shown[:, up]])

    return flat


def draw_bones(axes: Axes, model: Model, state: Postures, view: View, colour: str, label: str) -> None:
    """Bones as lines, the ellipsoid of the thorax, and the outline of the scapula's muscle attachments."""
    flat = flattened(model, state, view)
    thorax = max((surface for surface in model.surfaces if surface.kind == "ellipsoid"), key=_volume)
    axes.plot(*_outline(flat(_ellipsoid(thorax, state))).T, color=colour, linewidth=0.9, alpha=0.7)
    axes.fill(*_outline(flat(_attachments(model, state, "scapula"))).T, color=colour, alpha=0.2, linewidth=0.0)
    for index, (start, end) in enumerate(_bones(model, state)):
        axes.plot(*flat(np.stack([start, end])).T, color=colour, linewidth=2.4, label=label if index == 0 else None)


def save_picture(figure: Figure, name: str) -> None:
    """As a PNG with few colours, beside this file."""
    drawn = io.BytesIO()
    figure.savefig(drawn, dpi=110)
    Image.open(drawn).convert("RGB").quantize(COLOURS).save(HERE / name, optimize=True)


def _upright(model: Model) -> Array:
    """(1, coordinates) the default posture with the thorax upright, assembled."""
    wanted = model.default_coordinates
    for index, name in enumerate(model.coordinate_names):
        if name.startswith("ground_thorax"):
            wanted[index] = 0.0
    return assemble(model, wanted)[None]


def _bones(model: Model, state: Postures) -> list[tuple[Array, Array]]:
    """From the joint in which a bone moves to those of the bones beyond it, or to the point that a constraint joins."""
    lines = []
    joined = {
        constraint.body_1: constraint.location_1
        for constraint in model.constraints
        if isinstance(constraint, PointConstraint)
    }
    for joint in model.joints:
        name = model.bodies[joint.child].name
        if joint.parent == GROUND or name not in BONES:
            continue
        start = points_in_ground(state, joint.child, joint.frame_in_child.translation)[0]
        beyond = [other for other in model.joints if other.parent == joint.child]
        ends = [points_in_ground(state, other.parent, other.frame_in_parent.translation)[0] for other in beyond]
        if not ends:
            end = joined.get(joint.child, model.bodies[joint.child].mass_center)
            ends = [points_in_ground(state, joint.child, end)[0]]
        lines += [(start, end) for end in ends]
    return lines


def _attachments(model: Model, state: Postures, name: str) -> Array:
    """(points, 3) in ground where muscles are attached to a body."""
    body = model.body_index(name)
    points = [point for muscle in model.muscles for point in muscle.path.points if isinstance(point, PathPoint)]
    return np.concatenate([points_in_ground(state, body, point.location) for point in points if point.body == body])


def _volume(surface: WrapSurface) -> float:
    return float(np.prod(surface.dimensions))


def _ellipsoid(surface: WrapSurface, state: Postures) -> Array:
    """Points (points, 3) of an ellipsoid in ground."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 90), np.linspace(0, np.pi, 45))
    unit = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
    in_body = unit * surface.dimensions @ surface.placement.rotation.T + surface.placement.translation
    rotation, origin = state.rotation_to_ground[0, surface.body], state.origin_in_ground[0, surface.body]
    points: Array = in_body @ rotation.T + origin
    return points


def _outline(points: Array) -> Array:
    """Convex hull (points, 2), closed."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points).vertices
    return points[np.append(hull, hull[0])]


if __name__ == "__main__":
    draw_body(*(read_osim(Path(path)) for path in sys.argv[1:3]))
