"""Three bodies on a free joint, on curved axes and on a ball: what the bundled model has no joint for."""

import numpy as np

from solver.functions.coordinate_functions import polynomial, simm_spline
from solver.model import NO_COORDINATE, AxisMotion, BallMotion, Body, Coordinate, Joint, Model, Motion, Placement
from solver.multibody.postures import rotation_body_fixed_xyz


def linkage() -> Model:
    base = BallMotion((0, 1, 2), (3, 4, 5))
    bend = simm_spline(np.array([-2.0, -0.5, 0.4, 2.0]), np.array([0.2, -0.6, 0.5, 0.3]))
    curved = AxisMotion(
        axes=np.vstack([np.eye(3), np.eye(3)]),
        coordinate=np.array([6, 7, NO_COORDINATE, 7, 6, NO_COORDINATE]),
        functions=(bend, polynomial([0.1, 1.0, 0.3]), *[polynomial([0.0])], polynomial([0.0, 0.2, -0.1]), bend, bend),
    )
    motions = (base, curved, BallMotion((8, 9, 10), ()))
    kinds = ["rotation"] * 3 + ["translation"] * 3 + ["coupled"] * 2 + ["rotation"] * 3
    return Model(
        name="linkage",
        gravity=np.array([0.0, -9.8, 0.0]),
        bodies=(Body("ground", 0.0, np.zeros(3), np.zeros((3, 3))), *(_body(name) for name in ("root", "mid", "tip"))),
        coordinates=tuple(Coordinate(f"q{k}", kind, 0.0, (-2.0, 2.0)) for k, kind in enumerate(kinds)),  # type: ignore[arg-type]
        joints=tuple(_joint(k, motion) for k, motion in enumerate(motions)),
        surfaces=(),
        muscles=(),
        constraints=(),
        actuators=(),
        markers=(),
    )


def _body(name: str) -> Body:
    return Body(name, 1.5, np.array([0.02, -0.1, 0.01]), np.diag([0.02, 0.01, 0.015]))


def _joint(parent: int, motion: Motion) -> Joint:
    before = Placement(rotation_body_fixed_xyz([0.3, -0.2, 0.5]), np.array([0.1, -0.2, 0.05]))
    after = Placement(rotation_body_fixed_xyz([-0.1, 0.4, 0.2]), np.array([0.0, 0.1, 0.02]))
    return Joint(f"joint_{parent}", parent, parent + 1, before, after, motion)
