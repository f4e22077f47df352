"""A leg on a free pelvis as an .osim text, with a step of it: motion, ground reaction force and actuators, as files.

Pelvis, thigh, shank, foot and toes; a patella whose angle follows the knee's; toes that are locked; ten muscles. It is
the leg of no person: masses and lengths are about those of an adult.
"""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from solver.time_series_table import Array, write_table

Vector = tuple[float, float, float]

PELVIS = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")
LEG = ("hip_flexion", "hip_adduction", "hip_rotation", "knee_angle", "ankle_angle")
Z, X, Y = (0, 0, 1), (1, 0, 0), (0, 1, 0)
BODIES: dict[str, tuple[float, Vector, Vector]] = {  # mass, mass centre, moments of inertia
    "pelvis": (45.0, (-0.05, 0.15, 0.0), (2.1, 0.8, 2.0)),
    "thigh": (8.5, (0.0, -0.18, 0.01), (0.13, 0.035, 0.14)),
    "shank": (3.6, (0.01, -0.19, 0.0), (0.05, 0.006, 0.05)),
    "foot": (1.2, (0.06, -0.02, 0.0), (0.0012, 0.004, 0.0042)),
    "toes": (0.2, (0.03, 0.0, -0.01), (0.0001, 0.0002, 0.0002)),
    "patella": (0.1, (0.0, 0.01, 0.0), (0.00001, 0.00001, 0.00001)),
}
# child: parent, place in it, rotations (coordinate, axis), whether it also translates
JOINTS: dict[str, tuple[str, Vector, tuple[tuple[str, Vector], ...], bool]] = {
    "pelvis": ("ground", (0, 0, 0), (("pelvis_tilt", Z), ("pelvis_list", X), ("pelvis_rotation", Y)), True),
    "thigh": ("pelvis", (-0.07, -0.06, 0.08), tuple(zip(LEG[:3], (Z, X, Y), strict=True)), False),
    "shank": ("thigh", (0.0, -0.4, 0.0), (("knee_angle", (0, 0.1, 1)),), False),
    "foot": ("shank", (0.0, -0.42, 0.0), (("ankle_angle", (0.1, 0, 1)),), False),
    "toes": ("foot", (0.14, -0.03, 0.0), (("toe_angle", Z),), False),
    "patella": ("thigh", (0.05, -0.38, 0.0), (("patella_angle", Z),), False),
}
# largest force, fibre length, points
MUSCLES: dict[str, tuple[float, float, tuple[tuple[str, Vector], ...]]] = {
    "glutmax": (1600, 0.15, (("pelvis", (-0.16, 0.03, 0.06)), ("thigh", (-0.03, -0.09, 0.03)))),
    "glutmed": (1400, 0.08, (("pelvis", (-0.06, 0.06, 0.1)), ("thigh", (-0.01, -0.02, 0.05)))),
    "adductor": (1200, 0.1, (("pelvis", (-0.05, -0.1, 0.01)), ("thigh", (0.0, -0.16, 0.015)))),
    "iliopsoas": (1500, 0.11, (("pelvis", (0.0, 0.0, 0.06)), ("thigh", (0.0, -0.06, -0.01)))),
    "piriformis": (500, 0.06, (("pelvis", (-0.14, 0.0, 0.01)), ("thigh", (-0.02, -0.01, 0.04)))),
    "hamstring": (2200, 0.11, (("pelvis", (-0.12, -0.1, 0.06)), ("shank", (-0.03, -0.04, 0.0)))),
    "rectus": (
        1100,
        0.09,
        (("pelvis", (-0.02, -0.03, 0.08)), ("patella", (0.01, 0.02, 0)), ("shank", (0.04, -0.08, 0))),
    ),
    "vasti": (4500, 0.1, (("thigh", (0.03, -0.18, 0.01)), ("patella", (0.01, 0.02, 0)), ("shank", (0.04, -0.08, 0)))),
    "calf": (3500, 0.06, (("thigh", (-0.02, -0.38, 0.0)), ("foot", (-0.05, -0.02, 0.0)))),
    "tibialis": (900, 0.08, (("shank", (0.02, -0.15, 0.0)), ("foot", (0.06, 0.0, 0.01)))),
}
FOOT_IN_PELVIS = np.array([-0.07, -0.88, 0.08])


@dataclass(frozen=True)
class Step:
    """The files of a step: model, motion, external loads, and actuators of the pelvis and reserves of the leg."""

    model: Path
    motion: Path
    loads: Path
    actuators: Path


def step_in(folder: Path, kind: str = "Millard2012EquilibriumMuscle") -> Step:
    """Write the files of a step of 0.8 s at 100 Hz."""
    step = Step(*(folder / name for name in ("leg.osim", "step.sto", "loads.xml", "actuators.xml")))
    step.model.write_text(leg(kind), encoding="utf-8")
    write_motion(step.motion, (*PELVIS, *LEG, "patella_angle"))
    write_loads(step.loads)
    forces = dict.fromkeys(PELVIS, 500.0) | dict.fromkeys(LEG, 5.0)
    step.actuators.write_text(actuators(forces), encoding="utf-8")
    return step


def leg(kind: str = "Millard2012EquilibriumMuscle") -> str:
    """The model's text; kind is the class of its muscles."""
    bodies = "".join(
        f'<Body name="{name}"><mass>{mass}</mass><mass_center>{_text(center)}</mass_center>'
        f"<inertia>{_text(inertia)} 0 0 0</inertia></Body>"
        for name, (mass, center, inertia) in BODIES.items()
    )
    joints = "".join(_joint(child, *given) for child, given in JOINTS.items())
    muscles = "".join(_muscle(kind, name, *given) for name, given in MUSCLES.items())
    coupler = (
        '<CoordinateCouplerConstraint name="patella_follows"><coupled_coordinates_function><PolynomialFunction>'
        "<coefficients>0.1 0.6 0.05</coefficients></PolynomialFunction></coupled_coordinates_function>"
        "<independent_coordinate_names>knee_angle</independent_coordinate_names>"
        "<dependent_coordinate_name>patella_angle</dependent_coordinate_name></CoordinateCouplerConstraint>"
    )
    return (
        '<OpenSimDocument Version="40000"><Model name="leg"><gravity>0 -9.81 0</gravity><Ground name="ground"/>'
        f"<BodySet><objects>{bodies}</objects></BodySet><JointSet><objects>{joints}</objects></JointSet>"
        f"<ConstraintSet><objects>{coupler}</objects></ConstraintSet>"
        f"<ForceSet><objects>{muscles}</objects></ForceSet></Model></OpenSimDocument>"
    )


def step_angles(time: Array) -> dict[str, Array]:
    """Coordinate → its values at times (frames,) [rad, m]; smooth, and such as of a slow step."""
    swing = 2 * np.pi * time
    knee = -0.35 - 0.25 * np.cos(swing + 0.5) - 0.1 * np.sin(2 * swing)
    return {
        "pelvis_tilt": 0.05 + 0.03 * np.sin(2 * swing),
        "pelvis_list": 0.04 * np.cos(swing),
        "pelvis_rotation": 0.06 * np.sin(swing + 0.2),
        "pelvis_tx": 1.1 * time + 0.01 * np.sin(2 * swing),
        "pelvis_ty": 0.93 + 0.015 * np.cos(2 * swing),
        "pelvis_tz": 0.01 * np.sin(swing),
        "hip_flexion": 0.2 + 0.35 * np.cos(swing),
        "hip_adduction": -0.05 + 0.06 * np.sin(swing),
        "hip_rotation": 0.04 * np.cos(swing + 1.0),
        "knee_angle": knee,
        "ankle_angle": 0.05 + 0.2 * np.sin(swing + 0.4),
        "patella_angle": 0.05 + 0.6 * knee + 0.1 * knee**2,
    }


def write_motion(path: Path, names: tuple[str, ...]) -> None:
    """These coordinates of the step, in radians."""
    time = np.arange(81) / 100
    write_table(path, names, time, np.column_stack([step_angles(time)[name] for name in names]))


def write_loads(path: Path) -> None:
    """A ground reaction force that rises and falls, with its point under the foot, as a force plate records it."""
    time = np.linspace(-0.1, 1.0, 331)
    shape = np.sin(np.pi * np.clip(time / 0.8, 0.0, 1.0)) ** 2
    force = shape[:, None] * np.column_stack([-90 * np.cos(np.pi * time), 560 + 0 * time, 35 + 0 * time])
    angles = step_angles(time)
    place = np.column_stack([angles["pelvis_tx"] + 0.03, 0 * time, angles["pelvis_tz"] + FOOT_IN_PELVIS[2]])
    torque = shape[:, None] * np.column_stack([0 * time, 4.0 + 0 * time, 0 * time])
    names = [f"{part}_{axis}" for part in ("plate_v", "plate_p", "plate_t") for axis in "xyz"]
    write_table(path.with_suffix(".sto"), names, time, np.column_stack([force, place, torque]))
    path.write_text(
        '<OpenSimDocument Version="40000"><ExternalLoads name="plates"><objects><ExternalForce name="plate">'
        "<applied_to_body>foot</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>"
        "<point_expressed_in_body>ground</point_expressed_in_body><force_identifier>plate_v</force_identifier>"
        "<point_identifier>plate_p</point_identifier><torque_identifier>plate_t</torque_identifier></ExternalForce>"
        f"</objects><datafile>{path.with_suffix('.sto').name}</datafile></ExternalLoads></OpenSimDocument>",
        encoding="utf-8",
    )


def actuators(optimal: dict[str, float], limit: float = np.inf) -> str:
    """Text of a file with a ForceSet of CoordinateActuators: coordinate → optimal force."""
    objects = "".join(
        f'<CoordinateActuator name="{name}_actuator"><min_control>{-limit}</min_control><max_control>{limit}'
        f"</max_control><coordinate>{name}</coordinate><optimal_force>{force}</optimal_force></CoordinateActuator>"
        for name, force in optimal.items()
    )
    forces = f'<ForceSet name="reserves"><objects>{objects}</objects></ForceSet>'
    return f'<OpenSimDocument Version="40000">{forces}</OpenSimDocument>'


def _joint(child: str, parent: str, place: Vector, rotations: tuple[tuple[str, Vector], ...], is_moved: bool) -> str:
    turning = [*rotations, *(("", axis) for axis in (Z, X, Y)[len(rotations) :])]
    driven = [(f"rotation{i}", *rotation) for i, rotation in enumerate(turning, 1)]
    sliding = PELVIS[3:] if is_moved else ("", "", "")
    driven += [(f"translation{i}", name, axis) for i, name, axis in zip((1, 2, 3), sliding, (X, Y, Z), strict=True)]
    names = [name for _, name, _ in driven if name]
    coordinates = "".join(
        f'<Coordinate name="{name}"><default_value>{0.93 if name == "pelvis_ty" else 0.0}</default_value>'
        f"<locked>{'true' if name == 'toe_angle' else 'false'}</locked></Coordinate>"
        for name in names
    )
    axes = "".join(_axis(*axis) for axis in driven)
    body = "/ground" if parent == "ground" else f"/bodyset/{parent}"
    return (
        f'<CustomJoint name="{child}_joint"><socket_parent_frame>{child}_in_{parent}</socket_parent_frame>'
        f"<socket_child_frame>/bodyset/{child}</socket_child_frame><coordinates>{coordinates}</coordinates>"
        f'<frames><PhysicalOffsetFrame name="{child}_in_{parent}"><socket_parent>{body}</socket_parent>'
        f"<translation>{_text(place)}</translation></PhysicalOffsetFrame></frames>"
        f"<SpatialTransform>{axes}</SpatialTransform></CustomJoint>"
    )


def _axis(title: str, coordinate: str, axis: Vector) -> str:
    function = "<LinearFunction><coefficients>1 0</coefficients></LinearFunction>"
    still = "<Constant><value>0</value></Constant>"
    return (
        f'<TransformAxis name="{title}"><coordinates>{coordinate}</coordinates><axis>{_text(axis)}</axis>'
        f"{function if coordinate else still}</TransformAxis>"
    )


def _muscle(kind: str, name: str, force: float, fibre: float, points: tuple[tuple[str, Vector], ...]) -> str:
    """Its tendon is such that the fibre has its optimal length while the leg is straight."""
    places = [_place(body) + np.array(place) for body, place in points]
    length = sum(float(np.linalg.norm(b - a)) for a, b in pairwise(places))
    path = "".join(
        f'<PathPoint name="{name}_{i}"><socket_parent_frame>/bodyset/{body}</socket_parent_frame>'
        f"<location>{_text(place)}</location></PathPoint>"
        for i, (body, place) in enumerate(points)
    )
    return (
        f'<{kind} name="{name}"><GeometryPath><PathPointSet><objects>{path}</objects></PathPointSet></GeometryPath>'
        f"<max_isometric_force>{force}</max_isometric_force><optimal_fiber_length>{fibre}</optimal_fiber_length>"
        f"<tendon_slack_length>{length - fibre}</tendon_slack_length>"
        f"<pennation_angle_at_optimal>0.1</pennation_angle_at_optimal></{kind}>"
    )


def _place(body: str) -> Array:
    """Of its origin in the pelvis while all angles are zero."""
    return np.zeros(3) if body == "pelvis" else _place(JOINTS[body][0]) + np.array(JOINTS[body][1])


def _text(vector: Vector) -> str:
    return " ".join(map(str, vector))
