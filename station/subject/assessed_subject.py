"""A session's pose and motion trials → the wearer's own body, motion and suit.

The cord's tension that the load cell measured on the wearer is compared with the predicted one.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from documents.interval import counted
from documents.message import Message
from documents.regular_file import LARGEST_SUIT, read_regular
from fitting.cuffs.wearable_cuff import Cuff
from fitting.uncertainty import NORMAL_95
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.exchange.sample_tables import MarkerTable
from recordings.manifest import DataOrigin, Manifest, TrialCondition
from recordings.reader import open_recording
from solver.cuff import CuffParameters
from solver.inverse_kinematics.marker_fit import WholeMotion, longest_whole_motion, rotation_laboratory_to_ground
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureUncertainty,
    TrackingTasks,
    assemble,
    estimate_marker_noise,
    posture_uncertainty,
    solve_inverse_kinematics,
)
from solver.model import Array, Model
from solver.motion import Kinematics, differentiate
from solver.personalisation.estimate import within_ranges
from solver.personalisation.wearer_motion import MOST_STEPS, WearerMotion, smooth_wearer
from solver.scaling import scale_model
from solver.suit.cord import check_cord
from solver.suit.digitised_points import DigitisedSuit, fitted_to, suit_from_markers
from solver.suit.suit import Suit
from solver.uncertainty.varied_motion import DrawnMotion
from station.kinematics.ik import with_marker_set
from station.kinematics.marker_checks import Finding, pose_findings
from station.kinematics.person import PersonBody, PersonInputs, person_of_trials
from station.messages.kinematics_messages import PersonCode, SubjectCode
from station.progress import Progress, silent
from station.subject.subject_document import BodyFactor, CordTension, MarkerResidual, SubjectDocument, WearerFinding
from station.subject.subject_file import SUBJECT_FILE, Subject, read_subject, refuse_subject

ASSESSED: tuple[TrialCondition, ...] = ("unsuited", "slack", "tight")
"""The motion to assess is that of the first of these conditions that was recorded: the suit changes it least."""
DRAWS = 100
"""Bodies and motions drawn from the posterior: about one for every drawn person of the default."""


@dataclass(frozen=True, eq=False)
class MeasuredSubject:
    """The wearer's body, as estimated from pose and motion trials.

    declared    content of subject.toml
    trials      in time order, as are those of body
    """

    declared: Subject
    trials: tuple[WearerTrial, ...]
    body: PersonBody

    @property
    def model(self) -> Model:
        """The body that the postures are of."""
        return self.body.model

    @property
    def origin(self) -> DataOrigin:
        return DataOrigin.joined(trial.manifest.origin for trial in self.trials)

    def postures(self, trial: WearerTrial) -> InverseKinematics:
        return self.body.estimate.postures[self.trials.index(trial)]


@dataclass(frozen=True, eq=False)
class SmoothedSubject(MeasuredSubject):
    """The wearer's body of the posterior.

    solved      postures of inverse kinematics of each trial, within the ranges of the joints
    posterior   of body and of a motion, given markers of all trials and anatomy
    """

    solved: tuple[InverseKinematics, ...]
    posterior: WearerMotion

    def postures(self, trial: WearerTrial) -> InverseKinematics:
        """Coordinates of the posterior; residuals and outcomes are those of inverse kinematics."""
        solution = self.solved[self.trials.index(trial)]
        coordinates = solution.coordinates.copy()
        known = np.isfinite(coordinates[:, 0])
        coordinates[known] = self.posterior.postures(coordinates[known])
        return replace(solution, coordinates=coordinates)


@dataclass(frozen=True, eq=False)
class AssessedSubject(SmoothedSubject):
    """The wearer and a motion of theirs.

    assessed    the trial whose motion is assessed;  motion  of it;  kinematics  smoothed and differentiated
    uncertainty of the assessed trial's postures from the noise of the markers
    drawn       bodies and motions of the posterior
    """

    assessed: WearerTrial
    motion: WholeMotion
    kinematics: Kinematics
    uncertainty: PostureUncertainty
    drawn: tuple[DrawnMotion, ...]

    @property
    def not_measured(self) -> tuple[str, ...]:
        """Coordinates that no marker holds in the assessed trial; they keep the values of the default posture."""
        known = np.isfinite(self.solved[self.trials.index(self.assessed)].coordinates[:, 0])
        is_loose = np.atleast_1d((~self.uncertainty.is_held[known]).any(axis=0))
        return tuple(name for name, loose in zip(self.model.coordinate_names, is_loose, strict=True) if loose)


def build_subject(folder: Path, generic: Model, progress: Progress = silent) -> AssessedSubject:
    """Raises SubjectError, UnusableTrial, KinematicsError, PersonError, ModelError or MotionError for a folder from
    which no person can be assessed.
    """
    declared = read_subject(folder)
    trials = read_wearer_trials(folder)
    assessed = _assessed(folder, trials)
    measured = measure_subject(declared, trials, generic, progress)
    place = trials.index(assessed)
    observed = measured.body.observed[place]
    model, tasks, solved = _solved_within_ranges(measured)
    motion = longest_whole_motion(measured.model, assessed.time, solved[place])
    smoothed = smooth_subject(measured, solved, motion.motion.coordinates)
    motion = replace(motion, motion=replace(motion.motion, coordinates=smoothed.posterior.coordinates))
    interval = float(np.median(np.diff(assessed.time)))
    noise = np.nan_to_num(estimate_marker_noise(observed, interval))
    return AssessedSubject(
        declared=declared,
        trials=trials,
        body=smoothed.body,
        solved=solved,
        assessed=assessed,
        motion=motion,
        kinematics=differentiate(motion.motion),
        uncertainty=posture_uncertainty(model, observed, tasks, solved[place], noise),
        posterior=smoothed.posterior,
        drawn=tuple(
            DrawnMotion(scaling, differentiate(replace(motion.motion, coordinates=coordinates)))
            for scaling, coordinates in smoothed.posterior.draw(DRAWS)
        ),
    )


def smooth_subject(
    measured: MeasuredSubject, solved: tuple[InverseKinematics, ...] | None = None, wanted: Array | None = None
) -> SmoothedSubject:
    """The posterior of the body and of the motion wanted (frames, coordinates) [rad or m], by default the solved frames
    of the last trial.
    """
    body, solved = measured.body, solved or _solved_within_ranges(measured)[2]
    if wanted is None:
        wanted = solved[-1].coordinates[np.isfinite(solved[-1].coordinates[:, 0])]
    seen = list(zip(body.observed, solved, strict=True))
    posterior = smooth_wearer(body.generic, body.markers, body.estimate, seen, wanted)
    unfinished = [] if posterior.is_converged else [Message(PersonCode.NOT_CONVERGED, {"steps": MOST_STEPS})]
    model, findings = scale_model(body.model, posterior.scaling), (*body.findings, *unfinished)
    body = replace(body, model=model, findings=findings)
    return SmoothedSubject(measured.declared, measured.trials, body, solved, posterior)


def _solved_within_ranges(measured: MeasuredSubject) -> tuple[Model, TrackingTasks, tuple[InverseKinematics, ...]]:
    """The problem of inverse kinematics, and its solution of every trial."""
    model, tasks = within_ranges(measured.body.estimate.model, measured.body.estimate.tasks)
    return model, tasks, tuple(solve_inverse_kinematics(model, one, tasks) for one in measured.body.observed)


def measure_subject(
    declared: Subject, trials: tuple[WearerTrial, ...], generic: Model, progress: Progress = silent
) -> MeasuredSubject:
    """Estimate the body from these trials; raises as build_subject does."""
    if declared.mass_kg is None:
        raise refuse_subject(SubjectCode.NO_MASS)
    generic, _, on_marker_set = with_marker_set(generic, declared.marker_set)
    _ensure_known(declared, generic)
    tables = {trial.file: _table(trial, declared) for trial in trials}
    inputs = PersonInputs(
        generic.name, (), declared.mass_kg, held_mass=declared.hand_load_kg, vertical=declared.vertical
    )
    on_poses = [finding for trial in trials for finding in find_on_pose(trial)]
    body = person_of_trials(generic, tables, inputs, progress)
    return MeasuredSubject(declared, trials, replace(body, findings=(*on_marker_set, *on_poses, *body.findings)))


def read_wearer_trials(folder: Path, before_utc_ns: int | None = None) -> tuple[WearerTrial, ...]:
    """Pose and motion trials of a session that began before this time, in time order; of a repeat the newest run."""
    return tuple(read_wearer_trial(path) for path, _ in _newest_recordings(folder, before_utc_ns))


def fit_suit(subject: MeasuredSubject, suit: Suit) -> DigitisedSuit | None:
    """The suit with its points where its markers were seen on the wearer's model, and rest lengths in proportion; None
    without such markers.

    suit_markers of the configuration are those of waist, shoulder and arm, in this order.
    """
    seen = [trial for trial in subject.trials if len(trial.body.suit) == 3]
    if not seen:
        return None
    trial = min(seen, key=lambda one: (one.manifest.test != "pose", one.manifest.condition != "slack"))
    coordinates = subject.postures(trial).coordinates
    known = np.isfinite(coordinates[:, 0])
    own, generic = subject.model, subject.body.generic
    observed = _in_ground(subject, trial, trial.body.suit)
    found = suit_from_markers(suit, own, coordinates[known], observed[known])
    pattern = (suit, generic, assemble(generic))
    return replace(found, suit=fitted_to(found.suit, own, assemble(own), pattern))


def find_on_pose(trial: WearerTrial) -> list[Finding]:
    """Findings on a pose. Raises PersonError where the person moves."""
    if trial.manifest.test != "pose":
        return []
    labels = trial.body.body
    return pose_findings(labels, trial.markers[:, [trial.labels.index(label) for label in labels]])


def _in_ground(subject: MeasuredSubject, trial: WearerTrial, labels: Sequence[str]) -> Array:
    """(frames, labels, 3) [m], NaN where a marker is hidden: turned as the markers on the body were."""
    names = _names(trial, subject.declared)
    markers = [marker for marker in subject.body.markers if marker.name in names]
    observed = trial.markers[:, [names.index(marker.name) for marker in markers]]
    rotation = rotation_laboratory_to_ground(subject.body.generic, markers, observed, subject.declared.vertical)
    in_ground: Array = trial.markers[:, [trial.labels.index(label) for label in labels]] @ rotation.T
    return in_ground


def _names(trial: WearerTrial, declared: Subject) -> tuple[str, ...]:
    """The recorded labels under the names of the model's markers."""
    return tuple(declared.markers.get(label, label) for label in trial.labels)


def _table(trial: WearerTrial, declared: Subject) -> MarkerTable:
    rate = (len(trial.time) - 1) / float(trial.time[-1] - trial.time[0])
    positions = 1e3 * trial.markers
    return MarkerTable(_names(trial, declared), rate, trial.time, positions, np.zeros(positions.shape[:2]))


def _ensure_known(declared: Subject, generic: Model) -> None:
    """Raises SubjectError where subject.toml names a marker that is not the model's."""
    names = [marker.name for marker in generic.markers]
    unknown = [name for name in declared.markers.values() if name not in names]
    if unknown:
        figures = {"markers": ", ".join(unknown), "model": generic.name, "known": ", ".join(names)}
        raise refuse_subject(SubjectCode.UNKNOWN_MARKERS, **figures)


def _assessed(folder: Path, trials: Sequence[WearerTrial]) -> WearerTrial:
    motions = {trial.manifest.condition: trial for trial in reversed(trials) if trial.manifest.test == "motion"}
    for condition in ASSESSED:
        if condition in motions:
            return motions[condition]
    raise refuse_subject(SubjectCode.NO_MOTION, folder=str(folder), poses=len(trials))


def worn_arm_cuff(named: str | None, arms: Sequence[str]) -> str | None:
    """The arm cuff that counts as worn, live and where a measured cord is compared: the one that is named, else the
    only one that was fitted; None, rigid cuffs, where none or several were.
    """
    return named or (arms[0] if len(arms) == 1 else None)


def cuff_on_cord(folder: Path, cuffs: Iterable[Cuff]) -> str | None:
    """The arm cuff that was worn (worn_arm_cuff) in the trial whose measured cord tension is compared; None for rigid
    cuffs, or where no tension is compared.

    cuffs are all fitted ones, also those that are not assessed. Reads subject.toml and manifests alone. Raises
    SubjectError for a cuff that was not fitted.
    """
    cord = read_subject(folder).cord
    if cord is None or cord.rest_length_m is None:
        return None
    if not any(_is_cord_compared(manifest) for _, manifest in _newest_recordings(folder)):
        return None
    arms = [cuff.name for cuff in cuffs if cuff.site == "arm"]
    if cord.cuff is not None and cord.cuff not in arms:
        raise refuse_subject(SubjectCode.UNKNOWN_CUFF, cuff=cord.cuff, known=", ".join(arms))
    return worn_arm_cuff(cord.cuff, arms)


def compare_cord(
    subject: AssessedSubject, suit: Suit, waist: CuffParameters | None, arm: CuffParameters | None
) -> CordTension | None:
    """In the trial with a tight cord, with the waist and the arm cuff that were worn, rigid ones if arm is None; None
    where its tension or its rest length is not known.
    """
    cord = subject.declared.cord
    tight = [trial for trial in subject.trials if _is_cord_compared(trial.manifest)]
    if cord is None or cord.rest_length_m is None or not tight:
        return None
    trial = tight[0]
    motion = longest_whole_motion(subject.model, trial.time, subject.postures(trial)).motion
    measured = np.interp(motion.time, trial.force_time, trial.force)
    at_rest = replace(suit, reference_rest_length=cord.rest_length_m)
    worn = (waist, arm) if arm else (None, None)
    check = check_cord(at_rest, subject.model, differentiate(motion), measured, worn)
    return CordTension(
        arm_cuff=arm.name if arm else None,
        offset_n=check.offset,
        rms_n=check.rms,
        correlation=None if np.isnan(check.correlation) else check.correlation,
        largest_measured_n=float(check.measured.max()),
        largest_predicted_n=float(check.predicted.max()),
    )


def subject_document(
    subject: AssessedSubject, spread: dict[str, float] | None, cord: CordTension | None
) -> SubjectDocument:
    """spread of each suit marker about its point [m]; cord: None without a measured tension."""
    estimate = subject.body.estimate
    posterior = subject.posterior
    factors = {
        factor.name: BodyFactor(value=float(value), ci95=[float(value - NORMAL_95 * e), float(value + NORMAL_95 * e)])
        for factor, value, e in zip(estimate.priors.factors, posterior.factors, posterior.factor_errors, strict=True)
    }
    return SubjectDocument(
        mass_kg=subject.body.body_mass,
        hand_load_kg=subject.declared.hand_load_kg,
        origin=subject.origin,
        motion=subject.assessed.file,
        condition=subject.assessed.manifest.condition or "",
        frames=len(subject.kinematics.time),
        interpolated_frames=subject.motion.interpolated,
        frames_left_out=subject.motion.left_out,
        drawn_motions=DRAWS,
        body_outcome=estimate.outcome,
        is_whole=subject.body.is_whole,
        factors=factors,
        trials=[_residual(subject, place) for place in range(len(subject.trials))],
        coordinates_not_measured=list(subject.not_measured),
        suit_point_spread_m=spread,
        cord=cord,
        findings=[WearerFinding(code=finding.code, text=str(finding)) for finding in subject.body.findings],
    )


def subject_inputs(folder: Path, subject: AssessedSubject) -> dict[str, str]:
    """Roles of the assessment's inputs → what stood for them."""
    digest = hashlib.sha256(read_regular(folder / SUBJECT_FILE, LARGEST_SUIT)).hexdigest()
    recorded = subject.assessed.sha256
    return {
        "model": f"{subject.model.name}, scaled to the wearer by {counted(len(subject.trials), 'trial')}",
        "motion": f"{subject.assessed.file} {recorded}",
        "subject": f"{SUBJECT_FILE} {digest}",
    }


def _newest_recordings(folder: Path, before_utc_ns: int | None = None) -> list[tuple[Path, Manifest]]:
    """Recordings of the pose and motion trials that read_wearer_trials reads."""
    newest: dict[tuple[object, ...], tuple[Path, Manifest]] = {}
    for path in sorted(folder.glob("*.mcap")):
        manifest = open_recording(path).manifest
        if manifest.body is None or manifest.condition == "mvc":
            continue
        if before_utc_ns is not None and manifest.start_utc_ns >= before_utc_ns:
            continue
        key = manifest.test, manifest.condition, manifest.repeat
        if key not in newest or newest[key][1].start_utc_ns < manifest.start_utc_ns:
            newest[key] = path, manifest
    return sorted(newest.values(), key=lambda found: found[1].start_utc_ns)


def _is_cord_compared(manifest: Manifest) -> bool:
    return manifest.condition == "tight" and manifest.body is not None and manifest.body.is_cord_measured


def _residual(subject: AssessedSubject, place: int) -> MarkerResidual:
    postures = subject.body.estimate.postures[place]
    return MarkerResidual(
        file=subject.trials[place].file,
        rms_m=float(np.sqrt(np.nanmean(postures.residuals**2))),
        frames=len(postures.outcomes),
        unsolved_frames=postures.unsolved,
    )
