"""Make pulls from the trials of one donning: force and displacement along the rope, from one reference posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from documents.equality import EqualByFields
from fitting.errors import UnusableTrial
from fitting.pull.common_time import require_common_steps
from fitting.pull.cuff_motion import CuffMotion, along, cuff_motion, reference_posture
from fitting.pull.direction import (
    angle_between,
    find_other_directions,
    number_directions,
    pull_directions,
    turned_notes,
)
from fitting.pull.hung_weights import check_steps
from fitting.pull.marker_quality import MarkerQuality, marker_notes, marker_quality, turn_notes
from fitting.pull.plateaus import Plateau, find_plateaus
from fitting.pull.plausibility import (
    require_live_force,
    require_live_markers,
    require_plausible_displacement,
    require_positive_loads,
)
from fitting.results.codes import RejectionCode, TrialNoteCode
from fitting.results.rendering import Note
from fitting.trial.trial import Trial

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True, eq=False)
class Pull(EqualByFields):
    """Force and displacement of a cuff along the rope in one trial, on one clock: the signal that every fit reads.

    trial         source: provenance, calibration, lag, masses
    force_time, force          (n,) s, N, zero not removed
    marker_time, displacement  (frames,) s, m along `direction` in the donning's reference posture; NaN if hidden
    motion        of the cuff in three dimensions, in the anchor's frame
    direction     (3,) unit vector of the pull in that frame, common to all pulls of a test along the first line
    markers       quality of the markers
    plateaus      the held loads of a static trial, empty for a dynamic one
    notes         remarks on the pull and its trial
    direction_number  0 along the donning's first line of this test; 1, 2, … along the others in order of recording
    """

    trial: Trial
    force_time: NDArray[np.float64]
    force: NDArray[np.float64]
    marker_time: NDArray[np.float64]
    displacement: NDArray[np.float64]
    motion: CuffMotion
    direction: NDArray[np.float64]
    markers: MarkerQuality
    plateaus: tuple[Plateau, ...]
    notes: tuple[Note, ...]
    direction_number: int = 0

    def __post_init__(self) -> None:
        for array in (self.displacement, self.direction):
            array.setflags(write=False)

    def to_dataframe(self) -> pd.DataFrame:
        """A row per marker frame: time [s], force [N] interpolated to it, displacement [m]; units in attrs["units"]."""
        import pandas as pd

        force = np.interp(self.marker_time, self.force_time, self.force)
        table = pd.DataFrame({"time": self.marker_time, "force": force, "displacement": self.displacement})
        table.attrs["units"] = {"time": "s", "force": "N", "displacement": "m"}
        return table

    @property
    def is_along_another_line(self) -> bool:
        """Whether it is used for the three-dimensional tensors only."""
        return self.direction_number > 0


def make_pulls(trials: Sequence[Trial]) -> tuple[list[Pull], dict[str, Note]]:
    """The pulls of the usable trials, in the given order, and by file the reason why the others are unusable."""
    reasons: dict[str, Note] = {}
    reference, moved = None, []
    for trial in trials:
        try:
            if trial.cuff != trials[0].cuff:
                raise UnusableTrial(RejectionCode.OTHER_MARKERS)
            reference = reference or reference_posture(trial)
            moved.append(_move(trial, cuff_motion(trial, reference)))
        except UnusableTrial as error:
            reasons[trial.file] = error.reason
    if not moved:
        return [], reasons
    kept, motions = [candidate.trial for candidate in moved], [candidate.motion for candidate in moved]
    other_lines = find_other_directions(kept, motions)
    turned = turned_notes(kept, motions)
    first_line = [candidate for candidate in moved if candidate.trial.file not in other_lines]
    try:
        directions = pull_directions(
            [candidate.trial for candidate in first_line], [candidate.motion for candidate in first_line]
        )
    except UnusableTrial as error:
        return [], reasons | {trial.file: error.reason for trial in kept}
    numbers = number_directions(other_lines, {trial.file: trial.test for trial in kept})
    pulls = []
    for candidate in moved:
        file = candidate.trial.file
        direction, notes = directions[candidate.trial.test], turned.get(file, ())
        if file in other_lines:
            angle = angle_between(other_lines[file], direction)
            direction, notes = other_lines[file], (Note(TrialNoteCode.ANOTHER_LINE, {"angle_deg": angle}),)
        try:
            pulls.append(_project(candidate, direction, numbers.get(file, 0), notes))
        except UnusableTrial as error:
            reasons[file] = error.reason
    return pulls, reasons


def of_test(pulls: Sequence[Pull], test: str) -> list[Pull]:
    """The pulls of static or of dynamic trials."""
    return [pull for pull in pulls if pull.trial.test == test]


def newest_first(pulls: Sequence[Pull]) -> list[list[Pull]]:
    """The pulls of one test by repeat, in the order of their newest runs; within a repeat the newest run is first.

    Repeats are counted separately for every direction of the pull.
    """
    repeats: dict[tuple[int, int], list[Pull]] = {}
    for pull in sorted(pulls, key=lambda pull: pull.trial.run, reverse=True):
        repeats.setdefault((pull.direction_number, pull.trial.repeat), []).append(pull)
    return sorted(repeats.values(), key=lambda runs: (runs[0].trial.start_utc_ns, runs[0].trial.file))


@dataclass(frozen=True)
class _Moved:
    """A trial with the cuff's motion in three dimensions, before its direction is known."""

    trial: Trial
    motion: CuffMotion
    markers: MarkerQuality
    notes: tuple[Note, ...]


def _move(trial: Trial, motion: CuffMotion) -> _Moved:
    force = np.interp(trial.marker_time, trial.force_time, trial.force)
    quality = marker_quality(motion.displacement, motion.residual, motion.body, force, motion.ghosts)
    quality = replace(quality, loose=motion.loose)
    return _Moved(trial, motion, quality, marker_notes(quality) + turn_notes(motion.turn, force))


def _project(moved: _Moved, direction: NDArray[np.float64], number: int, turned: tuple[Note, ...]) -> Pull:
    """The pull along a direction (3,); turned are notes on this direction. Raises UnusableTrial."""
    trial = moved.trial
    displacement = along(moved.motion, direction)
    require_plausible_displacement(displacement)
    require_live_force(trial.force_time, trial.force, trial.marker_time, displacement)
    require_live_markers(trial.marker_time, trial.markers, trial.force_time, trial.force)
    plateaus: tuple[Plateau, ...] = ()
    notes = moved.notes + turned
    if trial.test == "static":
        plateaus = find_plateaus(
            trial.force_time, trial.force, trial.force_step, trial.marker_time, displacement, trial.step_times
        )
        require_positive_loads(plateaus)
        require_common_steps(trial.force_time, trial.force, trial.marker_time, displacement)
        notes += check_steps(plateaus, trial.step_masses)
    return Pull(
        trial=trial,
        force_time=trial.force_time,
        force=trial.force,
        marker_time=trial.marker_time,
        displacement=displacement,
        motion=moved.motion,
        direction=direction,
        markers=moved.markers,
        plateaus=plateaus,
        notes=trial.notes + notes,
        direction_number=number,
    )
