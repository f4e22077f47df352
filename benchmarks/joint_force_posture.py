"""Scapula and humerus of a lift as the markers alone show them, beside those of inverse kinematics.

    python -m benchmarks.joint_force_posture [--data ../shared/data/subject] [--lifts S8R_side S8R_back]

The markers of each bone keep their distances, so that they determine its rotation without a model. Prints per lift the
largest change of a distance, elevation of the arm and measured force, and for every posture:

- upward rotation of the scapula: angle of the line TS–AA above the horizontal of the thorax, least and greatest;
- turn of the humerus about its own axis from the highest posture of the first repeat to that of the others;
- pronation in these postures.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.joint_force_variants import Lift, PosedBody
from recordings.exchange.trc import read_trc
from solver.motion import differentiate
from solver.multibody.postures import postures
from station.validation.variants import CUTOFF_HZ
from tests.solver.references import SHARED

Array = NDArray[np.float64]

POSTURES: Mapping[str, PosedBody] = {
    "as published": PosedBody(
        is_plane_free=False, is_forearm_free=False, is_angle_tracked=False, girdle=0.0, rotation=0.0
    ),
    "plane of elevation free": PosedBody(
        is_plane_free=True, is_forearm_free=False, is_angle_tracked=False, girdle=0.0, rotation=0.0
    ),
    "forearm free, too": PosedBody(
        is_plane_free=True, is_forearm_free=True, is_angle_tracked=False, girdle=0.0, rotation=0.0
    ),
    "girdle held, too": PosedBody(
        is_plane_free=True, is_forearm_free=True, is_angle_tracked=False, girdle=1e-2, rotation=0.0
    ),
}
PRONATION = "pro_sup"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=SHARED / "subject", help="files of lifts: docs/validation.md")
    parser.add_argument("--lifts", nargs="+", default=["S8R_side", "S8R_back"])
    given = parser.parse_args()
    for name in given.lifts:
        lift = Lift(given.data, name)
        table = read_trc(given.data / f"{name}.trc")
        marker = {label: 1e-3 * table.positions[:, place] for place, label in enumerate(table.labels)}
        thorax = triad(marker["T8"], marker["C7"], marker["IJ"])
        elbow = 0.5 * (marker["EL"] + marker["EM"])
        humerus = triad(elbow, marker["GH"], marker["EL"])
        highest = [part.start + int(_elevation(thorax, humerus)[part].argmax()) for part in lift.repeats]
        print(
            f"\n{name}: elevation of the arm and largest measured force, by repeat: {_repeats(lift, thorax, humerus)}"
        )
        print(f"change of distances [mm]: {_changes_mm(marker)}")
        print(f"\n| {name} | upward rotation | turn of the humerus | pronation |\n|---|---:|---:|---:|")
        upward = _upward(thorax, marker["AA"] - marker["TS"])
        print(_row("markers", upward, _turns(thorax, humerus, highest), None))
        for title, posture in POSTURES.items():
            print(_row_of_posture(title, lift, posture, thorax, highest))


def triad(origin: Array, along: Array, beside: Array) -> Array:
    """Rotations (frames, 3, 3): columns along the line origin → along, normal to the plane of the three, third axis."""
    first = _unit(along - origin)
    normal = _unit(np.cross(first, beside - origin))
    return np.stack([first, normal, np.cross(first, normal)], axis=-1)


def twist(rotation: Array, axis: Array) -> float:
    """Part [rad] of a rotation (3, 3) that turns about the unit vector axis (3,) (swing-twist decomposition)."""
    skew = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    cosine = 0.5 * (1.0 + np.trace(rotation))  # 2 cos²(angle / 2)
    return float(2.0 * np.arctan2(skew @ axis, cosine))


def _row_of_posture(title: str, lift: Lift, posture: PosedBody, thorax: Array, highest: list[int]) -> str:
    motion = lift.posed_motion(posture)
    kinematics = differentiate(motion, CUTOFF_HZ)
    bodies = [body.name for body in lift.model.bodies]
    turned = postures(lift.model, kinematics.positions, kinematics.speeds).rotation_to_ground
    scapula, humerus = (turned[:, bodies.index(name)] for name in ("scapula", "humerus"))
    line = scapula @ (lift.model.marker("AA").location - lift.model.marker("TS").location)
    bone = humerus @ _along_humerus(lift)
    pronation = np.degrees(motion.coordinates[highest, lift.model.coordinate_index(PRONATION)])
    return _row(title, _upward(thorax, line), _turns(thorax, bone, highest), pronation)


def _along_humerus(lift: Lift) -> Array:
    """Axes (3, 3) in the model's humerus, as triad() has them: from elbow to head, normal, and the rest."""
    lateral, medial, head = (lift.model.marker(name).location for name in ("EL", "EM", "GH"))
    return triad(0.5 * (lateral + medial)[None], head[None], lateral[None])[0]


def _upward(thorax: Array, line: Array) -> Array:
    return np.degrees(np.arcsin((_unit(line) * thorax[..., 0]).sum(axis=-1)))


def _elevation(thorax: Array, humerus: Array) -> Array:
    """Angle [rad] between the arm, which points down at rest, and the spine."""
    return np.arccos((humerus[..., 0] * thorax[..., 0]).sum(axis=-1).clip(-1.0, 1.0))


def _changes_mm(marker: Mapping[str, Array]) -> str:
    """Range over the trial of the distances between markers of one bone [mm]."""
    pairs = (("AA", "TS"), ("AA", "AI"), ("TS", "AI"), ("EL", "EM"), ("GH", "EL"))
    ranges = [1e3 * float(np.ptp(np.linalg.norm(marker[a] - marker[b], axis=1))) for a, b in pairs]
    return ", ".join(f"{a}–{b} {found:.1f}" for (a, b), found in zip(pairs, ranges, strict=True))


def _repeats(lift: Lift, thorax: Array, humerus: Array) -> str:
    """Of every repeat, highest elevation against the spine [deg] and largest measured force [% of body weight]."""
    elevation = np.degrees(_elevation(thorax, humerus))
    forces = 100.0 * lift.measured / lift.body_weight
    rows = [f"{elevation[part].max():.0f}° and {np.nanmax(forces[part]):.0f} %" for part in lift.repeats]
    return ", ".join(rows)


def _turns(thorax: Array, humerus: Array, highest: list[int]) -> Array:
    """Degrees about the humerus' axis in the first of these frames, from it to the others."""
    relative = thorax[highest].swapaxes(1, 2) @ humerus[highest]
    return np.degrees([twist(relative[0].T @ other, np.array([1.0, 0.0, 0.0])) for other in relative[1:]])


def _row(title: str, upward: Array, turns: Array, pronation: Array | None) -> str:
    held = "" if pronation is None else ", ".join(f"{angle:.0f}°" for angle in pronation)
    turned = ", ".join(f"{angle:.0f}°" for angle in turns)
    return f"| {title} | {upward.min():.0f} to {upward.max():.0f}° | {turned} | {held} |"


def _unit(vectors: Array) -> Array:
    normed: Array = vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)
    return normed


if __name__ == "__main__":
    main()
