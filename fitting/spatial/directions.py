"""Which trials of a donning pull in another direction than its first: stiffness along one line must not pool them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.markers.frames import CuffMotion, pull_direction
from fitting.quality import UnusableTrial
from fitting.spatial.tensor import APART, angle_between
from fitting.trial import Trial

ELSEWHERE = "the trial counts in three dimensions only"
ELSEWHERE_NOTE = f"the rope pulls {{:.0f}}° away from the donning's first; {ELSEWHERE}"
TURNED_NOTE = (
    "the cuff goes {:.0f}° away from its way in the donning's first {} trial, and both count along one line; put two "
    "markers on the rope, which tell a turned pull from a cuff that slips sideways"
)


def pulled_elsewhere(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """File → the rope's unit vector (3,) for the trials, in time order, that differ from the first of their test.

    Static and dynamic trials that differ throughout are no set of directions but a fault, which D6 names; dynamic ones
    are held against the first static direction if any of them pulls along it. Without rope markers nobody knows.
    """
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if _shows_rope(motion)]
    ropes = _ways(pairs)
    first = _firsts(pairs, ropes)
    held = first.get("static")
    swung = [ropes[trial.file] for trial, _ in pairs if trial.test == "dynamic" and trial.file in ropes]
    if held is not None and any(angle_between(held, rope) < APART for rope in swung):
        first["dynamic"] = held
    return {
        trial.file: ropes[trial.file]
        for trial, _ in pairs
        if trial.file in ropes and angle_between(first[trial.test], ropes[trial.file]) >= APART
    }


def numbered(ways: Mapping[str, NDArray[np.float64]], tests: Mapping[str, str]) -> dict[str, int]:
    """File → number from 1 of its direction among those of its test, in the order in which files (of ways) came."""
    numbers: dict[str, int] = {}
    kinds: dict[str, list[NDArray[np.float64]]] = {}
    for file, way in ways.items():
        known = kinds.setdefault(tests[file], [])
        near = [i for i, kind in enumerate(known, 1) if angle_between(kind, way) < APART]
        if not near:
            known.append(way)
        numbers[file] = near[0] if near else len(known)
    return numbers


def pull_directions(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """Test → unit vector (3,) of its pull: the force of a test counts along the rope that exerted it.

    Without rope markers in the swings theirs is that of the held loads: a cuff may yield aside of the pull.
    Raises UnusableTrial where no cuff moves with the force.
    """
    pairs = list(zip(trials, motions, strict=True))
    static = [each for each in pairs if each[0].test == "static"] or pairs
    dynamic = [each for each in pairs if each[0].test == "dynamic"]
    dynamic = dynamic if any(_shows_rope(motion) for _, motion in dynamic) else static
    both = {"static": static, "dynamic": dynamic}
    return {test: pull_direction([each for each, _ in some], [each for _, each in some]) for test, some in both.items()}


def turned_notes(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, str]:
    """File → a note for the trials without rope markers in which the cuff goes another way than in the first."""
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if not _shows_rope(motion)]
    ways = _ways(pairs)
    first = _firsts(pairs, ways)
    angles = {
        trial.file: (angle_between(first[trial.test], ways[trial.file]), trial.test)
        for trial, _ in pairs
        if trial.file in ways
    }
    return {file: TURNED_NOTE.format(angle, test) for file, (angle, test) in angles.items() if angle >= APART}


def _shows_rope(motion: CuffMotion) -> bool:
    return motion.rope is not None and bool(np.isfinite(motion.rope).any())


def _ways(pairs: Sequence[tuple[Trial, CuffMotion]]) -> dict[str, NDArray[np.float64]]:
    """File → the trial's own direction of pull."""
    ways = {}
    for trial, motion in pairs:
        try:
            ways[trial.file] = pull_direction([trial], [motion])
        except UnusableTrial:  # said again where the trial is fitted
            continue
    return ways


def _firsts(
    pairs: Sequence[tuple[Trial, CuffMotion]], ways: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Test → the direction of its first trial."""
    first: dict[str, NDArray[np.float64]] = {}
    for trial, _ in pairs:
        if trial.file in ways:
            first.setdefault(trial.test, ways[trial.file])
    return first
