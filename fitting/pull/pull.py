"""Make pulls from the trials of one donning: force and displacement along the rope, from one reference posture.

A pull is refused if force and displacement of held loads do not change at the same times, because they are then not on
one clock. It has notes on stuck values, frozen markers, a wrong unit, a wrong sign.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy
from numpy.typing import NDArray

from documents.results import EqualByFields
from fitting.errors import UnusableTrial
from fitting.pull.consistency import require_common_steps, require_own_labels, require_steady_cell
from fitting.pull.cuff_motion import (
    OCCLUSION_LIMIT,
    OCCLUSION_NOTE,
    CuffMotion,
    MarkerQuality,
    along,
    cuff_motion,
    marker_notes,
    marker_quality,
    pull_direction,
    reference_posture,
)
from fitting.pull.plateaus import MIN_TOLERANCE, UNLOADED, Plateau, check_steps, find_plateaus
from fitting.results.sentences import Note
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.trial.calibration import code_width
from fitting.trial.clocks import LONGEST_FORCE_GAP
from fitting.trial.trial import Trial

if TYPE_CHECKING:
    import pandas as pd

SWING_DRIFT = 0.5
"""Part of the range of the force by which it may drift in a swing, whose fit includes a drift."""
STUCK = 1.0
MOST_CREEP = 0.2
"""Part of the range of displacement by which the cuff may creep or slip while the load is held."""
QUIET_PERCENTILE, LEAST_PROBABILITY = 10, 1e-9
"""Percentile of the noise over the seconds of a record, and the probability below which a stuck value is reported."""
SOFTEST, CLEAR_TRAVEL = 100.0, 2e-3
"""N/m that no cuff is below, and metres that are no marker noise."""
SHORT, NOISE_SPREAD = 0.1, 8.0
"""Seconds over which a force is averaged, and the spread of the means, in their standard errors, of noise alone: its
0.5 and 99.5 percentiles are 5.2 apart."""
TURN_NOTE = 0.5e-3
"""Metres by which the cuff's markers move apart under the load, from which it is reported."""
APART = 10.0
"""Degrees from which two pulls are different directions."""
MOST_DISPLACEMENT, LEAST_DISPLACEMENT = 1.0, 1e-6


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

    def __repr__(self) -> str:
        seen = 1e3 * self.displacement[np.isfinite(self.displacement)]
        span = f"{seen.min():.3g} to {seen.max():.3g} mm" if seen.size else "hidden"
        return f"Pull of {self.trial!r}, displacement {span}, {len(self.plateaus)} held loads"

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
            if reference is None:
                require_own_labels(trial)
                reference = reference_posture(trial)
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
    """The trial with its motion, NaN in the frames within long gaps of the force, and notes. Raises UnusableTrial."""
    force = np.interp(trial.marker_time, trial.force_time, trial.force)
    quality = marker_quality(motion.displacement, motion.residual, motion.body, force, motion.ghosts)
    quality = replace(quality, loose=motion.loose)
    is_missing, missing_notes = _missing_force(trial)
    motion = replace(motion, displacement=np.where(is_missing[:, None], np.nan, motion.displacement))
    notes = missing_notes + marker_notes(quality) + turn_notes(motion.turn, force)
    common = float(np.mean(np.isfinite(motion.displacement).all(axis=1)))
    if common < 1 - OCCLUSION_LIMIT:
        figures = {"share": common, "limit": 1 - OCCLUSION_LIMIT}
        raise UnusableTrial(RejectionCode.LITTLE_IN_COMMON, figures)
    return _Moved(trial, motion, quality, notes)


def _missing_force(trial: Trial) -> tuple[NDArray[np.bool_], tuple[Note, ...]]:
    """Frames (frames,) in gaps of the force that are too long to interpolate, and a note if they are many.

    Raises UnusableTrial if they are most of the frames.
    """
    is_missing = np.zeros(len(trial.marker_time), bool)
    for start, end in trial.force_gaps:
        if end - start > LONGEST_FORCE_GAP:
            is_missing |= (trial.marker_time > start) & (trial.marker_time < end)
    share = float(np.mean(is_missing))
    if share > OCCLUSION_LIMIT:
        raise UnusableTrial(RejectionCode.FORCE_MISSING, {"share": share, "limit": OCCLUSION_LIMIT})
    if share > OCCLUSION_NOTE:
        return is_missing, (Note(TrialNoteCode.FORCE_MISSING, {"share": share}),)
    return is_missing, ()


def _project(moved: _Moved, direction: NDArray[np.float64], number: int, turned: tuple[Note, ...]) -> Pull:
    """The pull along a direction (3,); turned are notes on this direction. Raises UnusableTrial."""
    trial = moved.trial
    displacement = along(moved.motion, direction)
    require_plausible_displacement(displacement)
    signals = trial.force_time, trial.force, trial.marker_time, displacement
    require_live_force(*signals)
    require_live_markers(trial.marker_time, trial.markers, trial.force_time, trial.force)
    part, least = (UNLOADED, MIN_TOLERANCE) if trial.test == "static" else (SWING_DRIFT, 0.0)
    require_steady_cell(*signals, max(part * float(np.ptp(trial.force)), least))
    plateaus: tuple[Plateau, ...] = ()
    notes = moved.notes + turned
    if trial.test == "static":
        plateaus = find_plateaus(
            trial.force_time, trial.force, trial.force_step, trial.marker_time, displacement, trial.step_times
        )
        require_positive_loads(plateaus)
        require_common_steps(*signals)
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


def require_live_force(
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
    marker_time: NDArray[np.float64],
    displacement: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if force (n,) [N] keeps one value for a second although it should change, or is noise alone
    while the cuff (frames,) [m] moves.

    A held load may stay at one code. It is stuck if the cuff moves meanwhile, or if the noise of the quietest seconds
    of the force makes one code for so long improbable.
    """
    bounds = np.concatenate(([0], np.flatnonzero(np.diff(force)) + 1, [len(force)]))
    runs = np.column_stack((bounds[:-1], bounds[1:]))
    travel = float(np.nanpercentile(displacement, 99.5) - np.nanpercentile(displacement, 0.5))
    for first, last in runs[force_time[runs[:, 1] - 1] - force_time[runs[:, 0]] > STUCK]:
        start, end = float(force_time[first]), float(force_time[last - 1])
        here = displacement[(marker_time >= start) & (marker_time <= end)]
        here = here[np.isfinite(here)]
        moves = len(here) > 20 and np.percentile(here, 97.5) - np.percentile(here, 2.5) > MOST_CREEP * travel
        elsewhere = np.concatenate((force[:first], force[last:]))
        noise = _quietest_noise(elsewhere, max(5, round((last - first) / (end - start))))
        if moves or _probability_of_one_code(elsewhere, noise, last - first) < LEAST_PROBABILITY:
            figures = {"force_n": float(force[first]), "duration_s": end - start, "start_s": start}
            if moves:
                raise UnusableTrial(RejectionCode.FORCE_STUCK_MOVING, figures)
            raise UnusableTrial(RejectionCode.FORCE_STUCK_QUIET, {**figures, "noise_n": noise})
    width = max(1, round(SHORT / float(np.median(np.diff(force_time)))))
    change = _spread(scipy.ndimage.uniform_filter1d(force, width))
    noise = float(np.std(np.diff(force))) / math.sqrt(2 * width)
    if travel > CLEAR_TRAVEL and change < min(SOFTEST * travel, NOISE_SPREAD * noise):
        raise UnusableTrial(RejectionCode.FORCE_NOISE, {"force_n": float(np.mean(force)), "travel_m": travel})


def require_live_markers(
    marker_time: NDArray[np.float64],
    markers: NDArray[np.float64],
    force_time: NDArray[np.float64],
    force: NDArray[np.float64],
) -> None:
    """Raise UnusableTrial if markers (frames, labels, 3) are constant for a second while force (n,) [N] changes.

    Under a constant force they may, because a simulator may have no noise.
    """
    same = (np.diff(markers, axis=0) == 0) | np.isnan(markers[1:]) & np.isnan(markers[:-1])
    still = same.all(axis=(1, 2)) & np.isfinite(markers[1:]).any(axis=(1, 2))
    bounds = np.flatnonzero(np.diff(np.concatenate(([False], still, [False]))))
    travel = _spread(force)
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        start, end = float(marker_time[first]), float(marker_time[last])
        meanwhile = force[(force_time >= start) & (force_time <= end)]
        if end - start > STUCK and len(meanwhile) > 1 and _spread(meanwhile) > travel / 2:
            raise UnusableTrial(RejectionCode.MARKERS_FROZEN, {"duration_s": end - start, "start_s": start})


def require_plausible_displacement(displacement: NDArray[np.float64]) -> None:
    """Raise UnusableTrial if displacement (frames,) [m] is impossible for a cuff, which indicates a wrong unit."""
    scatter = float(np.nanstd(displacement))
    if scatter > MOST_DISPLACEMENT or scatter < LEAST_DISPLACEMENT:
        figures = {"rms_m": scatter, "least_m": LEAST_DISPLACEMENT, "most_m": MOST_DISPLACEMENT}
        raise UnusableTrial(RejectionCode.DISPLACEMENT_UNIT, figures)


def require_positive_loads(plateaus: Sequence[Plateau]) -> None:
    """Raise UnusableTrial if the force falls when weights are added: the sign of the load cell is wrong."""
    if not plateaus:
        return
    start = plateaus[0].force
    largest = max(plateaus, key=lambda plateau: abs(plateau.force - start))
    if largest.force < start - 5 * max(largest.force_sd, 0.1) and largest.force < 0:
        raise UnusableTrial(RejectionCode.FORCE_POLARITY, {"before_n": start, "after_n": largest.force})


def _quietest_noise(force: NDArray[np.float64], second: int) -> float:
    """Standard deviation [N] of force (n,) in its quieter seconds; second is the number of samples in one.

    It is computed from third differences, which amplify white noise by √20 and contain little of a 1 Hz swing.
    """
    seconds = force[: len(force) // second * second].reshape(-1, second)
    noise = np.std(np.diff(seconds, 3, axis=1), axis=1) / math.sqrt(20)
    return float(np.percentile(noise, QUIET_PERCENTILE)) if len(seconds) else 0.0


def _probability_of_one_code(force: NDArray[np.float64], noise: float, count: int) -> float:
    """Probability that `count` samples at the centre of a code all have this code, for normal noise [N]."""
    step = code_width(force)
    dithering = math.sqrt(max(0.0, noise**2 - step**2 / 12))  # Sheppard's correction: noise of the quantisation
    if dithering == 0:
        return 1.0
    return math.erf(step / 2 / dithering / math.sqrt(2)) ** count


def _spread(force: NDArray[np.float64]) -> float:
    """Newtons between the 0.5 and 99.5 percentiles."""
    low, high = np.percentile(force, [0.5, 99.5])
    return float(high - low)


def turn_notes(turn: NDArray[np.float64], force: NDArray[np.float64]) -> tuple[Note, ...]:
    """A note if the cuff's markers move apart with the load, from their rms (frames,) [m] and force (frames,) [N]."""
    seen = np.isfinite(turn)
    if not seen.any() or np.ptp(force[seen]) == 0:
        return ()
    load = force[seen] - force[seen].mean()
    apart = float(load @ turn[seen] / (load @ load)) * float(np.ptp(force[seen]))
    if apart <= TURN_NOTE:
        return ()
    return (Note(TrialNoteCode.TURNS, {"apart_m": apart}),)


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
