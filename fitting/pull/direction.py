"""Find trials of a donning in another direction than its first trial; stiffness along one line must not pool them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.errors import UnusableTrial
from fitting.pull.cuff_motion import CuffMotion, pull_direction
from fitting.results.codes import TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.trial import Trial

APART = 10.0
"""Degrees from which two pulls are different directions."""


def find_other_directions(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """File → unit vector (3,) of the rope, for the trials (in time order) that differ from the first of their test.

    If all dynamic trials differ from the static ones, that is a fault, which D6 reports. Otherwise dynamic trials are
    compared with the first static direction. Without rope markers the direction of a trial is unknown.
    """
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if _shows_rope(motion)]
    ropes = _trial_directions(pairs)
    first = _first_directions(pairs, ropes)
    held = first.get("static")
    swung = [ropes[trial.file] for trial, _ in pairs if trial.test == "dynamic" and trial.file in ropes]
    if held is not None and any(angle_between(held, rope) < APART for rope in swung):
        first["dynamic"] = held
    return {
        trial.file: ropes[trial.file]
        for trial, _ in pairs
        if trial.file in ropes and angle_between(first[trial.test], ropes[trial.file]) >= APART
    }


def number_directions(directions: Mapping[str, NDArray[np.float64]], tests: Mapping[str, str]) -> dict[str, int]:
    """File → number of its direction within its test, from 1, in the order of the files in directions."""
    numbers: dict[str, int] = {}
    kinds: dict[str, list[NDArray[np.float64]]] = {}
    for file, direction in directions.items():
        known = kinds.setdefault(tests[file], [])
        near = [i for i, kind in enumerate(known, 1) if angle_between(kind, direction) < APART]
        if not near:
            known.append(direction)
        numbers[file] = near[0] if near else len(known)
    return numbers


def pull_directions(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """Test → unit vector (3,) of its pull, along the rope that exerts the force.

    Dynamic trials without rope markers use the direction of the static ones, as a cuff may move obliquely to the pull.
    Raises UnusableTrial if the cuff does not move with the force.
    """
    pairs = list(zip(trials, motions, strict=True))
    static = [pair for pair in pairs if pair[0].test == "static"] or pairs
    dynamic = [pair for pair in pairs if pair[0].test == "dynamic"]
    dynamic = dynamic if any(_shows_rope(motion) for _, motion in dynamic) else static
    both = {"static": static, "dynamic": dynamic}
    return {
        test: pull_direction([trial for trial, _ in of_test], [motion for _, motion in of_test])
        for test, of_test in both.items()
    }


def turned_notes(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, tuple[Note, ...]]:
    """File → note, for trials without rope markers in which the cuff moves in another direction than in the first."""
    pairs = [(trial, motion) for trial, motion in zip(trials, motions, strict=True) if not _shows_rope(motion)]
    directions = _trial_directions(pairs)
    first = _first_directions(pairs, directions)
    angles = {
        trial.file: (angle_between(first[trial.test], directions[trial.file]), trial.test)
        for trial, _ in pairs
        if trial.file in directions
    }
    return {
        file: (Note(TrialNoteCode.TURNED, {"angle_deg": angle, "test": test}),)
        for file, (angle, test) in angles.items()
        if angle >= APART
    }


def angle_between(one: NDArray[np.float64], other: NDArray[np.float64]) -> float:
    """Angle [degrees] between the lines along two unit vectors (3,)."""
    return math.degrees(math.acos(min(1.0, abs(float(one @ other)))))


def _shows_rope(motion: CuffMotion) -> bool:
    return motion.rope is not None and bool(np.isfinite(motion.rope).any())


def _trial_directions(pairs: Sequence[tuple[Trial, CuffMotion]]) -> dict[str, NDArray[np.float64]]:
    """File → the trial's own direction of pull."""
    directions = {}
    for trial, motion in pairs:
        try:
            directions[trial.file] = pull_direction([trial], [motion])
        except UnusableTrial:  # raised again when the trial is fitted
            continue
    return directions


def _first_directions(
    pairs: Sequence[tuple[Trial, CuffMotion]], directions: Mapping[str, NDArray[np.float64]]
) -> dict[str, NDArray[np.float64]]:
    """Test → the direction of its first trial."""
    first: dict[str, NDArray[np.float64]] = {}
    for trial, _ in pairs:
        if trial.file in directions:
            first.setdefault(trial.test, directions[trial.file])
    return first
