"""Write the files of the leg for examples/suit_on_a_leg.py: model, stride, force of the ground, suit and cuff.

    python examples/leg/make_leg.py [FOLDER]

The data are constructed, not measured. Published figures name their source; the others are our own.
"""

import json
import sys
import xml.etree.ElementTree as Xml
from math import radians
from pathlib import Path

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

FOLDER = Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent

MASS, HEIGHT = 75.0, 1.75  # kg, m

# Leg. Masses and mass centres are the shares of Winter 2005 (Biomechanics and Motor Control of Human Movement, 3rd
# edition, table 4.1); lengths, radii of gyration and the foot are assumed. Forces and fibres of the muscles
# are within 1.5 %, pennations within 0.6 degrees of those in lenhart2015.osim, which are from Arnold's leg
# (github.com/clnsmith/opensim-jam, Apache License 2.0); both heads of the gastrocnemius are one muscle.
# Rajagopal2016.osim (github.com/opensim-org/opensim-models) has fibres within 1.5 % of these, and 1.7 to 2.5 times the
# forces. Straight paths, and tendons that suit these, are our own. Muscles of hip and knee are left out: actuators
# move these joints.

THIGH, SHANK, ANKLE = 0.245 * HEIGHT, 0.246 * HEIGHT, 0.039 * HEIGHT  # m
BODIES = {  # mass [kg], mass centre from the upper joint [m], radius of gyration [m]
    "thigh": (0.100 * MASS, (0, -0.433 * THIGH, 0), 0.323 * THIGH),
    "shank": (0.0465 * MASS, (0, -0.433 * SHANK, 0), 0.302 * SHANK),
    "foot": (0.0145 * MASS, (0.06, -0.5 * ANKLE, 0), 0.475 * 0.152 * HEIGHT),
}
MUSCLES = {  # greatest force [N], fibre [m], tendon [m], pennation [deg], points from origin to insertion [m]
    "soleus": (3600, 0.044, 0.289, 28, [("shank", (-0.02, -0.15, 0)), ("foot", (-0.05, -0.04, 0))]),
    "gastrocnemius": (1900, 0.053, 0.429, 10, [("thigh", (-0.02, 0.01 - THIGH, 0)), ("foot", (-0.05, -0.04, 0))]),
    "tibialis_anterior": (
        *(670, 0.068, 0.262, 10),
        [("shank", (0.01, -0.16, 0)), ("shank", (0.04, 0.02 - SHANK, 0)), ("foot", (0.09, -0.04, 0))],
    ),
}


def write_xml(name: str, text: str) -> None:
    root = Xml.fromstring(text)  # noqa: S314  (our own text)
    Xml.indent(root)
    (FOLDER / name).write_text(Xml.tostring(root, encoding="unicode") + "\n")


def row(values) -> str:
    return " ".join(f"{value:.6g}" for value in values)


def body(name: str) -> str:
    mass, center, gyration = BODIES[name]
    inertia = mass * gyration**2 * np.array([1, 0.1, 1, 0, 0, 0])  # the leg does not turn about its long axis
    numbers = f"<mass>{mass:g}</mass><mass_center>{row(center)}</mass_center><inertia>{row(inertia)}</inertia>"
    return f'<Body name="{name}">{numbers}</Body>'


def joint(kind: str, name: str, parent: str, child: str, place: tuple, coordinates: tuple) -> str:
    frame = f'<PhysicalOffsetFrame name="{name}_frame"><socket_parent>{parent}</socket_parent>'
    frame += f"<translation>{row(place)}</translation></PhysicalOffsetFrame>"
    moved = "".join(f'<Coordinate name="{coordinate}"/>' for coordinate in coordinates)
    sockets = f"<socket_parent_frame>{name}_frame</socket_parent_frame>"
    sockets += f"<socket_child_frame>/bodyset/{child}</socket_child_frame>"
    return f'<{kind} name="{name}">{sockets}<coordinates>{moved}</coordinates><frames>{frame}</frames></{kind}>'


def muscle(name: str) -> str:
    force, fibre, tendon, pennation, points = MUSCLES[name]
    path = "".join(
        f'<PathPoint name="{name}_{i}"><socket_parent_frame>/bodyset/{part}</socket_parent_frame>'
        f"<location>{row(place)}</location></PathPoint>"
        for i, (part, place) in enumerate(points)
    )
    return (
        f'<Millard2012EquilibriumMuscle name="{name}"><max_isometric_force>{force}</max_isometric_force>'
        f"<optimal_fiber_length>{fibre}</optimal_fiber_length><tendon_slack_length>{tendon}</tendon_slack_length>"
        f"<pennation_angle_at_optimal>{radians(pennation):g}</pennation_angle_at_optimal><GeometryPath>"
        f"<PathPointSet><objects>{path}</objects></PathPointSet></GeometryPath></Millard2012EquilibriumMuscle>"
    )


def actuator(coordinate: str) -> str:
    return (
        f'<CoordinateActuator name="{coordinate}_actuator"><coordinate>{coordinate}</coordinate></CoordinateActuator>'
    )


HIP = ("thigh_angle", "hip_x", "hip_y")
joints = joint("PlanarJoint", "hip", "/ground", "thigh", (0, 0, 0), HIP)
joints += joint("PinJoint", "knee", "/bodyset/thigh", "shank", (0, -THIGH, 0), ("knee_angle",))
joints += joint("PinJoint", "ankle", "/bodyset/shank", "foot", (0, -SHANK, 0), ("ankle_angle",))
forces = "".join(map(muscle, MUSCLES)) + "".join(map(actuator, (*HIP, "knee_angle")))
write_xml(
    "leg.osim",
    '<OpenSimDocument Version="40500"><Model name="leg"><Ground name="ground"/><gravity>0 -9.80665 0</gravity>'
    f"<BodySet><objects>{''.join(map(body, BODIES))}</objects></BodySet>"
    f"<JointSet><objects>{joints}</objects></JointSet><ForceSet><objects>{forces}</objects></ForceSet>"
    "</Model></OpenSimDocument>",
)

# Stride. Constructed, not measured: angles and ground reaction force are smooth curves of textbook shape through round
# numbers (x forward, y up; thigh and ankle positive in flexion, knee negative). Percentages are of the stride.

STRIDE, SPEED, WEIGHT = 1.3, 1.0, MASS * 9.80665  # s, m/s, N
ANGLES = {  # percent → degrees
    "thigh_angle": {0: 22, 12: 18, 30: 3, 50: -13, 62: -5, 75: 13, 87: 24, 100: 22},
    "knee_angle": {0: -5, 15: -18, 40: -6, 50: -10, 62: -38, 72: -60, 85: -30, 95: -4, 100: -5},
    "ankle_angle": {0: 0, 7: -4, 20: 4, 45: 10, 56: 0, 64: -14, 74: -6, 84: 1, 100: 0},
}
GROUND = {  # percent → share of the body's weight, forward and up; m from the ankle, along the foot
    "force_x": {0: 0, 10: -0.15, 32: 0, 50: 0.15, 61: 0, 100: 0},
    "force_y": {0: 0, 12: 1.05, 31: 0.8, 48: 1.05, 61: 0, 100: 0},
    "point_x": {0: -0.04, 15: 0.03, 45: 0.11, 62: 0.16, 100: 0.16},
}
time = np.arange(0.0, STRIDE + 1e-9, 0.01)
percent = 100 * time / STRIDE


def curve(knots: dict, smooth) -> np.ndarray:
    return smooth(list(knots), list(knots.values()))(percent)


def write_table(name: str, columns: dict, in_degrees: str) -> None:
    head = f"{name}\nnRows={len(time)}\nnColumns={1 + len(columns)}\ninDegrees={in_degrees}\nendheader\n"
    rows = np.column_stack([time, *columns.values()])
    text = "\n".join("\t".join(f"{value:.9g}" for value in values) for values in rows)
    (FOLDER / name).write_text(head + "\t".join(["time", *columns]) + "\n" + text + "\n")


def periodic(x: list, y: list) -> CubicSpline:
    return CubicSpline(x, y, bc_type="periodic")


motion = {name: curve(knots, periodic) for name, knots in ANGLES.items()}
motion |= {"hip_x": SPEED * time, "hip_y": np.full_like(time, 0.5 * HEIGHT)}
write_table("stride.mot", motion, in_degrees="yes")
ground = {name: curve(knots, PchipInterpolator) for name, knots in GROUND.items()}
still = np.zeros_like(time)
forces = {"force_x": WEIGHT * ground["force_x"], "force_y": WEIGHT * ground["force_y"], "force_z": still}
write_table("ground.mot", {**forces, "point_x": ground["point_x"], "point_y": still - ANKLE, "point_z": still}, "no")
write_xml(
    "ground.xml",
    '<OpenSimDocument Version="40500"><ExternalLoads name="ground"><objects><ExternalForce name="foot">'
    "<applied_to_body>foot</applied_to_body><force_expressed_in_body>ground</force_expressed_in_body>"
    "<point_expressed_in_body>foot</point_expressed_in_body><force_identifier>force_</force_identifier>"
    "<point_identifier>point_</point_identifier></ExternalForce></objects><datafile>ground.mot</datafile>"
    "</ExternalLoads></OpenSimDocument>",
)

# Suit. A straight cord 7 cm behind the leg, from the shank cuff to the heel. In a suit file the ends are `arm`,
# where the fitted cuff is, and `waist`; `names` says what they are here. The cuff is the hand cuff of the published
# study, as if it were worn on the shank, because no shank cuff has been measured.

(FOLDER / "shank_suit.toml").write_text("""reference_rest_length_m = 0.328
rest_lengths_m = { first = 0.31, last = 0.344, count = 18 }
names = { waist = "heel", arm = "shank" }

[exotendon]
stiffness_n_per_m = 15000.0
damping_n_s_per_m = 0.0

[exotendon.waist]
body = "foot"
point_m = [-0.07, -0.04, 0.0]

[exotendon.arm]
body = "shank"
point_m = [-0.07, -0.14, 0.0]

[masses.arm]
body = "shank"
mass_kg = 0.2
center_m = [0.0, -0.14, 0.0]
inertia_kg_m2 = [6e-4, 7e-4, 6e-4]

[groups]
calf = ["soleus", "gastrocnemius"]
""")
(FOLDER / "shank.json").write_text(
    json.dumps({"cuffs": {"shank": {"stiffness_n_per_m": 8520, "damping_n_s_per_m": 210, "migration_m": 0.012}}})
)
(FOLDER / "effort.toml").write_text(
    f"unweighted_coordinates = {json.dumps([*HIP, 'knee_angle'])}  # their muscles are not in the model\n"
)
