"""A person with a known truth, seen by markers on the skin; shares no code with the estimate.

Kinematics are those of the simulated bench (drivers/simulators/shoulder.py: product of exponentials) on segments of the
person's own size. Skin slides from where a marker was put as the arm is raised: over the scapula by the medians of
upright CT (Sensors 22:6502, 2022), at the epicondyles so that axial rotation is wrong by 5 degrees on average while the
arm is raised (Hamming et al. 2012, J. Electromyogr. Kinesiol. 22:437, against bone pins). Scapula and clavicle follow
the arm at a ratio of the person's own (Braman et al. 2009; Dayanidhi et al. 2005).
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.simulators.errors import SimulatorError
from drivers.simulators.shoulder import SEGMENTS, Shoulder, published_table

Array = NDArray[np.float64]

MARKERS = ("ij", "px", "c7", "t8", "ac", "aa", "ts", "ai", "gu", "EpL", "EpM")
SIZES = {"thorax": (0.108, 0.100, 0.075), "clavicle": (0.081,), "scapula": (0.089,), "humerus": (0.065,)}
"""Coefficients of variation of chest depth, height and breadth, biacromial breadth, shoulder and upper arm length in
ANSUR II (both sexes); COMMON is the part of their variance that all share."""
COMMON = 0.5
REST_DEG = {
    "clav_prot": -17.2,
    "clav_elev": -3.7,
    "scapula_abduction": -17.9,
    "scapula_elevation": -2.9,
    "scapula_upward_rot": 11.9,
    "scapula_winging": 15.7,
}
"""The published model's posture of the girdle."""
REST_SD_DEG = 7.0
RAISED_DEG = {"clav_prot": -22.0, "clav_elev": 13.0, "scapula_winging": -6.0}
"""Change of the girdle when the arm is raised by RAISE_DEG (clavicle: Ludewig et al. 2004)."""
RAISE_DEG = 85.0
RATIO, RATIO_SD = 0.43, 0.12
"""Upward rotation of the scapula per glenohumeral elevation: 0.43, and 10.1 of 29.1 degrees between adults, less what
the person's size and instruments add."""
CLOSING = tuple(REST_DEG)
SLIDE = {"ac": 0.016, "aa": 0.0304, "ts": 0.0531, "ai": 0.0700}  # m, medians
SLIDE_SD = {"thorax": 0.012, "humerus": 0.015, "EpL": 0.010, "EpM": 0.010}
"""m along each axis, of the slide of another marker when the arm is raised."""
PLACEMENT_SD = {"thorax": 0.009, "scapula": 0.009, "humerus": 0.009, "EpL": 0.004, "EpM": 0.004}
"""m along each axis: palpation, and another shape of the bone (4 mm: Langenderfer et al. 2009, Comput. Methods
Biomech. Biomed. Eng. 12:211)."""
CORD_SD = 0.010
"""m along each axis, of where a marker of the cord is put, from the point at which the cord pulls."""
RATE, CYCLE = 12.5, 3.2  # Hz, s
WANDER, NOISE = 0.001, 0.0003  # m


@dataclass(frozen=True, eq=False)
class MeasuredPerson:
    """factors (3,) of a segment by name; coordinates of each trial (frames, 15) in the order of shoulder; what is seen
    of it (frames, markers, 3) [m]. In the last trial (frames, 3, 3): cord, the points at which the cord pulls, and the
    markers that are seen of them.
    """

    shoulder: Shoulder
    factors: dict[str, Array]
    coordinates: tuple[Array, ...]
    trials: tuple[Array, ...]
    cord: Array
    cord_markers: Array


def measure_person(seed: int, hanging_deg: float = 16.0) -> MeasuredPerson:
    """A pose and two raises of the arm, the second of which is to be assessed, from about this elevation."""
    chance = np.random.default_rng((seed, 77))
    factors, shoulder, motions = _drawn(chance, hanging_deg)
    points = [shoulder.markers[name] for name in MARKERS]
    sd = [_of(PLACEMENT_SD, name, segment) for name, (segment, _) in zip(MARKERS, points, strict=True)]
    placed = np.array(sd)[:, None] * chance.standard_normal((len(MARKERS), 3))
    seated = [(segment, place + off) for (segment, place), off in zip(points, placed, strict=True)]
    slide = np.array([_slide(name, segment, chance) for name, (segment, _) in zip(MARKERS, points, strict=True)])
    seen = tuple(_seen(shoulder, motion, seated, slide, chance) for motion in motions)
    cord = list(shoulder.cord.values())
    beside = [(segment, place + CORD_SD * chance.standard_normal(3)) for segment, place in cord]
    return MeasuredPerson(
        shoulder, factors, motions, seen, *(shoulder.places(motions[-1], places) for places in (cord, beside))
    )


def _drawn(chance: np.random.Generator, hanging_deg: float) -> tuple[dict[str, Array], Shoulder, tuple[Array, ...]]:
    """Sizes and motions. Bones that meet only in an unusual posture of the girdle are as rare as that posture."""
    while True:
        factors = _sizes(chance)
        shoulder = scaled_shoulder(factors)
        habits = [_habit(chance, hanging_deg) for _ in range(3)]
        usual = _wanted(shoulder, REST_DEG, {}, 0.0, habits[0], 0.0)[:1]
        try:
            moved = np.degrees(shoulder.closed(usual, CLOSING) - usual) / REST_SD_DEG
            if chance.uniform() > np.exp(-0.5 * (moved**2).sum()):
                continue
            ratio = RATIO + RATIO_SD * chance.standard_normal()
            rest = {name: value + REST_SD_DEG * chance.standard_normal() for name, value in REST_DEG.items()}
            change = {name: value * (1.0 + 0.4 * chance.standard_normal()) for name, value in RAISED_DEG.items()}
            heights = (0.0, *chance.uniform(0.75, 1.0, 2))
            return (
                factors,
                shoulder,
                tuple(
                    shoulder.closed(_wanted(shoulder, rest, change, ratio, habit, height), CLOSING)
                    for habit, height in zip(habits, heights, strict=True)
                ),
            )
        except SimulatorError:
            continue


def _sizes(chance: np.random.Generator) -> dict[str, Array]:
    """The model's owner is a member of the population, too: twice the variance."""
    common = chance.standard_normal()
    factors = {}
    for segment, variations in SIZES.items():
        own = chance.standard_normal(len(variations))
        spread = np.sqrt(2.0) * np.array(variations) * (np.sqrt(COMMON) * common + np.sqrt(1.0 - COMMON) * own)
        factors[segment] = np.exp(np.broadcast_to(spread, 3))
    return factors


def scaled_shoulder(factors: Mapping[str, Array]) -> Shoulder:
    """The published shoulder with segments of another size: places in a segment, and of the joint on it, grow along."""
    table = published_table()
    for segment in SEGMENTS:
        row = table[segment]
        on = factors.get(row.get("on", ""), np.ones(3))
        for key, factor in (("origin_m", on), ("ellipsoid_m", on), ("own_origin_m", factors[segment])):
            if key in row:
                row[key] = (np.array(row[key]) * factor).tolist()
    joined = table["acromioclavicular"]
    for segment in ("clavicle", "scapula"):
        joined[f"{segment}_m"] = (np.array(joined[f"{segment}_m"]) * factors[segment]).tolist()
    for row in (*table["markers"].values(), *table["cord"].values()):
        for segment in row:
            row[segment] = (np.array(row[segment]) * factors[segment]).tolist()
    return Shoulder(table)


def _habit(chance: np.random.Generator, hanging_deg: float) -> tuple[Array, Array]:
    """Plane of elevation, elevation and axial rotation [deg] at rest and raised."""
    rest = np.array([chance.uniform(10.0, 60.0), hanging_deg + 3.0 * chance.standard_normal(), 0.0])
    rest[2] = 25.0 - rest[0] + 10.0 * chance.standard_normal()  # the elbow's axis, which both turn about
    change = np.array([8.0, 0.0, 15.0]) * chance.standard_normal(3)
    change[1] = RAISE_DEG
    return rest, change


def _wanted(
    shoulder: Shoulder,
    rest: dict[str, float],
    change: dict[str, float],
    ratio: float,
    habit: tuple[Array, Array],
    height: float,
) -> Array:
    """Up and down once; a pose where the height is 0."""
    time = np.arange(int(RATE * CYCLE) if height else 5) / RATE
    part = height * 0.5 * (1.0 - np.cos(2.0 * np.pi * time / CYCLE))
    found = np.zeros((len(time), len(shoulder.coordinate_names)))
    for name, value in rest.items():
        found[:, shoulder.index(name)] = value + change.get(name, 0.0) * part
    found[:, shoulder.index("scapula_upward_rot")] += ratio * RAISE_DEG * part
    for name, low, more in zip(("plane_elv", "shoulder_elv", "axial_rot"), *habit, strict=True):
        found[:, shoulder.index(name)] = low + more * part
    return np.radians(found)


def _of(table: dict[str, float], name: str, segment: str) -> float:
    return table.get(name, table.get(segment, 0.0))


def _slide(name: str, segment: str, chance: np.random.Generator) -> Array:
    """(3,) [m] in the segment, when the arm is raised by RAISE_DEG."""
    if name in SLIDE:
        direction = chance.standard_normal(3)
        return SLIDE[name] * np.exp(0.3 * chance.standard_normal()) * direction / np.linalg.norm(direction)
    return _of(SLIDE_SD, name, segment) * chance.standard_normal(3)


def _seen(
    shoulder: Shoulder, motion: Array, points: list[tuple[str, Array]], slide: Array, chance: np.random.Generator
) -> Array:
    """(frames, markers, 3): bones, skin that has slid, slow wander of the skin and noise."""
    poses = shoulder.poses(motion)
    elevation = motion[:, shoulder.index("shoulder_elv")] - np.radians(16.0)
    part = (elevation / np.radians(RAISE_DEG)).clip(0.0, None) ** 1.2
    turned = np.stack(
        [part[:, None] * (poses[segment][:, :3, :3] @ one) for (segment, _), one in zip(points, slide, strict=True)],
        axis=1,
    )
    time = np.arange(len(motion)) / RATE
    waves = np.stack([np.sin(2.0 * np.pi * f * time + a) for f, a in zip((0.4, 0.9), (0.3, 1.7), strict=True)])
    wander = WANDER * np.einsum("wf,wmi->fmi", waves, chance.standard_normal((2, len(points), 3)))
    return shoulder.places(motion, points) + turned + wander + NOISE * chance.standard_normal(turned.shape)
