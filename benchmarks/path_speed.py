"""Time of a muscle path beside MuJoCo's tendons, in one run.

    python benchmarks/path_speed.py [--myo-sim FOLDER]

FOLDER is a copy of github.com/MyoHub/myo_sim in a folder of that name; without it only the second comparison is made.
The package is the extra `peers`. Processor times, the least of several alternating repeats, on one core:

- the 33 paths of the model of `station rmr`, beside the 67 tendons of MyoArm, each with its own surfaces: ours has
  ellipsoids and paths over two surfaces in turn, MuJoCo spheres and cylinders, between two points one at most;
- the same geometry in both: the same bodies, points and postures, and the spheres and cylinders of the paths that have
  one; ellipsoids, second surfaces and the ends of cylinders are left out.

Ours is `evaluate_paths`: lengths, speeds, and the forces of a unit tension on the bodies. MuJoCo's is `mj_tendon`
(lengths and moment arms) and `mj_transmission` (forces), called from Python, less the time of a call on an empty model.
The kinematics before it are not counted, nor its lengthening speeds, a product with the moment arms.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

ROOT = Path(__file__).parents[1]
REPEATS, CALLS = 15, 40
POSTURES = 40

sys.path.insert(0, str(ROOT))

from benchmarks.rmr import subject  # noqa: E402
from solver.model import Model, PathPoint  # noqa: E402
from solver.model import Path as MusclePath  # noqa: E402
from solver.multibody.postures import Postures, postures  # noqa: E402
from solver.paths import evaluate_paths  # noqa: E402

Array = NDArray[np.float64]
HINGES = (6, 2, 4, 3, 1, 1, 0)
"""Degrees of freedom of the bodies below ground in the bundled model, for MuJoCo's moment arms."""
AXES = ("1 0 0", "0 1 0", "0 0 1")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--myo-sim", type=Path, help="copy of github.com/MyoHub/myo_sim")
    arguments = parser.parse_args()
    import mujoco

    model, kinematics, name = subject()
    state = postures(model, kinematics.positions, kinematics.speeds)
    print(f"{name}: {len(kinematics.time)} frames; MuJoCo {mujoco.__version__}")
    if arguments.myo_sim:
        arm = mujoco.MjModel.from_xml_path(str(arguments.myo_sim / "arm/myoarm.xml"))
        print(f"all paths of the model, MyoArm's {arm.ntendon} tendons with {arm.nwrap} elements")
        compare(model, state, [muscle.path for muscle in model.muscles], arm, random_postures(arm))
    paths = [with_one_surface(model, path) for path in model_paths(model)]
    twin = mujoco.MjModel.from_xml_string(twin_of(model, paths))
    chosen = np.linspace(0, len(kinematics.time) - 1, POSTURES).astype(int)
    placings = [placing_of(model, twin, state, frame) for frame in chosen]
    lengths = np.array([lengths_of(twin, placing) for placing in placings])
    gaps = 1e3 * np.abs(lengths - evaluate_paths(model, state, paths).lengths[chosen])
    print(f"the same {len(paths)} paths, {sum(len(path.wraps) for path in paths)} with a sphere or a cylinder")
    print(f"    lengths differ by {np.median(gaps):.4f} mm in the median, {gaps.max():.2f} mm at most")
    compare(model, state, paths, twin, placings)


def compare(
    model: Model, state: Postures, paths: Sequence[MusclePath], other: Any, placings: list[Callable[[Any], None]]
) -> None:
    import mujoco

    frames = len(state.coordinates)
    empty = mujoco.MjModel.from_xml_string("<mujoco/>")
    ours, theirs, call = np.inf, np.full(len(placings), np.inf), np.inf
    data, nothing = mujoco.MjData(other), mujoco.MjData(empty)
    evaluate_paths(model, state, paths)
    for _ in range(REPEATS):
        start = process_time()
        evaluate_paths(model, state, paths)
        ours = min(ours, (process_time() - start) / frames / len(paths))
        call = min(call, seconds_of(empty, nothing))
        for k, place in enumerate(placings):
            place(data)
            theirs[k] = min(theirs[k], seconds_of(other, data))
    tendon = (theirs.mean() - call) / other.ntendon
    print(f"    MuJoCo  {1e6 * tendon:6.3f} µs a tendon")
    print(f"    ours    {1e6 * ours:6.3f} µs a path, {ours / tendon:.2f} times MuJoCo's")


def seconds_of(model: Any, data: Any) -> float:
    """Of one evaluation of the tendons in the posture that `data` is in."""
    import mujoco

    start = process_time()
    for _ in range(CALLS):
        mujoco.mj_tendon(model, data)
        mujoco.mj_transmission(model, data)
    return (process_time() - start) / CALLS


def random_postures(model: Any) -> list[Callable[[Any], None]]:
    """Joint angles in the inner half of their ranges."""
    import mujoco

    generator = np.random.default_rng(1)
    low, high = model.jnt_range.T

    def placing(angles: Array) -> Callable[[Any], None]:
        def place(data: Any) -> None:
            data.qpos[model.jnt_qposadr] = angles
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)

        return place

    return [placing(low + generator.uniform(0.25, 0.75, len(low)) * (high - low)) for _ in range(POSTURES)]


def model_paths(model: Model) -> list[MusclePath]:
    """Paths of the muscles whose points are fixed in their bodies."""
    paths = [muscle.path for muscle in model.muscles]
    return [path for path in paths if all(isinstance(point, PathPoint) for point in path.points)]


def with_one_surface(model: Model, path: MusclePath) -> MusclePath:
    """Over its first sphere or cylinder at most, between its first two points, as MuJoCo has it."""
    round_ones = [wrap for wrap in path.wraps if model.surfaces[wrap.surface].kind in {"sphere", "cylinder"}]
    return replace(path, wraps=tuple(replace(wrap, first=0, last=1) for wrap in round_ones[:1]))


def twin_of(model: Model, paths: Sequence[MusclePath]) -> str:
    """MuJoCo's XML: bodies with hinges, whose places are set by placing_of; sites, geoms, tendons and actuators."""
    surfaces = sorted({wrap.surface for path in paths for wrap in path.wraps})
    inside: dict[int, list[str]] = {body: [] for body in range(len(model.bodies))}
    for k in surfaces:
        surface = model.surfaces[k]
        quaternion = Rotation.from_matrix(surface.placement.rotation).as_quat(scalar_first=True)
        size = numbers(surface.dimensions[[0, 2]] / [1, 2] if surface.kind == "cylinder" else surface.dimensions[:1])
        place = f'pos="{numbers(surface.placement.translation)}" quat="{numbers(quaternion)}"'
        inside[surface.body].append(f'<geom name="g{k}" type="{surface.kind}" size="{size}" {place}/>')
        if surface.quadrant != "all":
            axis, sign = "xyz".index(surface.quadrant[-1]), -1 if surface.quadrant[0] == "-" else 1
            outwards = sign * surface.placement.rotation[:, axis]
            beside = surface.placement.translation + 2 * surface.dimensions[0] * outwards
            inside[surface.body].append(f'<site name="side{k}" pos="{numbers(beside)}"/>')
    tendons, actuators = [], []
    for i, path in enumerate(paths):
        parts = []
        for j, point in enumerate(path.points):
            inside[point.body].append(f'<site name="p{i}_{j}" pos="{numbers(point.location)}"/>')
            parts.append(f'<site site="p{i}_{j}"/>')
            if j == 0:
                parts += [wrapped(model, wrap.surface) for wrap in path.wraps]
        tendons.append(f'<spatial name="t{i}">{"".join(parts)}</spatial>')
        actuators.append(f'<general tendon="t{i}"/>')
    return (
        '<mujoco><default><geom contype="0" conaffinity="0" mass="0.1"/></default>'
        f"<worldbody>{nested(model, 0, inside)}</worldbody>"
        f"<tendon>{''.join(tendons)}</tendon><actuator>{''.join(actuators)}</actuator></mujoco>"
    )


def wrapped(model: Model, k: int) -> str:
    beside = f' sidesite="side{k}"' if model.surfaces[k].quadrant != "all" else ""
    return f'<geom geom="g{k}"{beside}/>'


def nested(model: Model, body: int, inside: dict[int, list[str]]) -> str:
    """A body with the things on it and the bodies whose joints have it as parent."""
    children = [joint.child for joint in model.joints if joint.parent == body]
    inner = "".join(inside[body]) + "".join(nested(model, child, inside) for child in children)
    if body == 0:
        return inner
    kinds = ["hinge"] * min(HINGES[body - 1], 3) + ["slide"] * max(HINGES[body - 1] - 3, 0)
    joints = "".join(f'<joint type="{kind}" axis="{AXES[k % 3]}"/>' for k, kind in enumerate(kinds))
    inertia = '<inertial mass="1" pos="0 0 0" diaginertia="0.01 0.01 0.01"/>'
    return f'<body name="b{body}">{inertia}{joints}{inner}</body>'


def placing_of(model: Model, twin: Any, state: Postures, frame: int) -> Callable[[Any], None]:
    """Put MuJoCo's bodies where ours are, by their places in their parents; all its joints stay at zero."""
    import mujoco

    rotations, origins = state.rotation_to_ground[frame], state.origin_in_ground[frame]
    places = []
    for joint in model.joints:
        turn = rotations[joint.parent].T
        quaternion = Rotation.from_matrix(turn @ rotations[joint.child]).as_quat(scalar_first=True)
        apart = turn @ (origins[joint.child] - origins[joint.parent])
        places.append((twin.body(f"b{joint.child}").id, apart, quaternion))

    def place(data: Any) -> None:
        for body, place_in_parent, quaternion in places:
            twin.body_pos[body], twin.body_quat[body] = place_in_parent, quaternion
        mujoco.mj_kinematics(twin, data)
        mujoco.mj_comPos(twin, data)

    return place


def lengths_of(twin: Any, place: Callable[[Any], None]) -> Array:
    import mujoco

    data = mujoco.MjData(twin)
    place(data)
    mujoco.mj_tendon(twin, data)
    return np.array(data.ten_length)


def numbers(values: Array) -> str:
    return " ".join(f"{value:.17g}" for value in values)


if __name__ == "__main__":
    main()
