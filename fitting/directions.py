"""Which trials of a donning pull in another direction than its first: stiffness along one line must not pool them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fitting.frames import CuffMotion, pull_direction
from fitting.quality import UnusableTrial
from fitting.tensor import APART, angle_between
from fitting.trial import Trial

ELSEWHERE_NOTE = "the rope pulls {:.0f}° away from the donning's first; the trial counts in three dimensions only"


def pulled_elsewhere(trials: Sequence[Trial], motions: Sequence[CuffMotion]) -> dict[str, NDArray[np.float64]]:
    """File → the rope's unit vector (3,) for the trials, in time order, that differ from the first of their test.

    Static and dynamic trials that differ throughout are no set of directions but a fault, which D6 names; dynamic ones
    are held against the first static direction if any of them pulls along it. Without rope markers nobody knows.
    """
    ropes = {}
    for trial, motion in zip(trials, motions, strict=True):
        if motion.rope is not None and np.isfinite(motion.rope).any():
            try:
                ropes[trial.file] = pull_direction([trial], [motion])
            except UnusableTrial:  # said again where the trial is fitted
                continue
    tests = {trial.file: trial.test for trial in trials}
    static = [rope for file, rope in ropes.items() if tests[file] == "static"]
    dynamic = [rope for file, rope in ropes.items() if tests[file] == "dynamic"]
    first = {"static": static[:1], "dynamic": dynamic[:1]}
    if static and any(angle_between(static[0], rope) < APART for rope in dynamic):
        first["dynamic"] = static[:1]
    return {file: rope for file, rope in ropes.items() if angle_between(first[tests[file]][0], rope) >= APART}
