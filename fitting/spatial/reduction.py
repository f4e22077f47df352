"""Trials of one donning → the cuff's displacement along the pull, all against one reference posture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from fitting import quality
from fitting.markers import frames
from fitting.markers.frames import CuffMotion
from fitting.markers.frozen import require_live_markers
from fitting.markers.turning import turn_notes
from fitting.quality import MarkerQuality, UnusableTrial
from fitting.spatial.directions import ELSEWHERE_NOTE, numbered, pull_directions, pulled_elsewhere, turned_notes
from fitting.spatial.tensor import angle_between
from fitting.static.plateaus import Plateau, find_plateaus
from fitting.static.steps import check_steps
from fitting.static.stiffness import require_positive_loads
from fitting.trial import Trial


@dataclass(frozen=True)
class ReducedTrial:
    """A trial and its displacement (frames,) [m] along the pull, in the reference posture of the donning.

    motion     of the cuff in three dimensions, in the anchor's frame
    direction  (3,) unit vector of the pull in that frame, the same for all trials of one test but those elsewhere
    markers    how far they can be believed
    plateaus   the held loads of a static trial, empty for a dynamic one
    """

    trial: Trial
    motion: CuffMotion
    direction: NDArray[np.float64]
    displacement: NDArray[np.float64]
    markers: MarkerQuality
    plateaus: tuple[Plateau, ...]
    notes: tuple[str, ...]
    pull: int = 0
    """0 in the direction of the donning's first trial of this test, 1, 2, … in each other one as they came."""

    @property
    def is_elsewhere(self) -> bool:
        """Whether it counts in three dimensions only."""
        return self.pull > 0


def reduce_trials(trials: Sequence[Trial]) -> tuple[list[ReducedTrial], dict[str, str]]:
    """The trials that can be used, in the order given, and by file why the others cannot."""
    reasons: dict[str, str] = {}
    reference, moved = None, []
    for trial in trials:
        try:
            if trial.cuff != trials[0].cuff:
                raise UnusableTrial("its markers are not those of the donning's first trial; use one configuration")
            reference = reference or frames.reference_posture(trial)
            motion = frames.cuff_motion(trial, reference)
            moved.append((trial, motion, *_markers(trial, motion)))
        except UnusableTrial as error:
            reasons[trial.file] = str(error)
    if not moved:
        return [], reasons
    elsewhere = pulled_elsewhere([each[0] for each in moved], [each[1] for each in moved])
    turned_away = turned_notes([each[0] for each in moved], [each[1] for each in moved])
    along = [each for each in moved if each[0].file not in elsewhere]
    try:
        direction = pull_directions([each[0] for each in along], [each[1] for each in along])
    except UnusableTrial as error:
        return [], reasons | {each[0].file: str(error) for each in moved}
    numbers = numbered(elsewhere, {trial.file: trial.test for trial, *_ in moved})
    reduced = []
    for trial, motion, markers, notes in moved:
        try:
            turned = elsewhere.get(trial.file)
            if turned is None:
                said = (*notes, turned_away[trial.file]) if trial.file in turned_away else notes
                reduced.append(_project(trial, motion, markers, said, direction[trial.test]))
                continue
            said = (*notes, ELSEWHERE_NOTE.format(angle_between(turned, direction[trial.test])))
            reduced.append(replace(_project(trial, motion, markers, said, turned), pull=numbers[trial.file]))
        except UnusableTrial as error:
            reasons[trial.file] = str(error)
    return reduced, reasons


def _markers(trial: Trial, motion: CuffMotion) -> tuple[MarkerQuality, tuple[str, ...]]:
    force = np.interp(trial.marker_time, trial.force_time, trial.force)
    found = quality.marker_quality(motion.displacement, motion.residual, motion.body, force, motion.ghosts)
    found = replace(found, loose=motion.loose)
    return found, quality.marker_notes(found) + turn_notes(motion.turn, force)


def _project(
    trial: Trial, motion: CuffMotion, markers: MarkerQuality, notes: tuple[str, ...], direction: NDArray[np.float64]
) -> ReducedTrial:
    displacement = frames.along(motion, direction)
    quality.require_plausible_displacement(displacement)
    quality.require_live_force(trial.force_time, trial.force, trial.marker_time, displacement)
    require_live_markers(trial.marker_time, trial.markers, trial.force_time, trial.force)
    plateaus: tuple[Plateau, ...] = ()
    if trial.test == "static":
        plateaus = find_plateaus(
            trial.force_time, trial.force, trial.force_step, trial.marker_time, displacement, trial.step_times
        )
        require_positive_loads(plateaus)
        notes += check_steps(plateaus, trial.step_masses)
    return ReducedTrial(trial, motion, direction, displacement, markers, plateaus, trial.notes + notes)
