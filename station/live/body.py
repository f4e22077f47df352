"""The body and suit to solve live: those of the wearer where the session has trials of theirs, else generic ones."""

from __future__ import annotations

import xml.etree.ElementTree as Xml
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from documents.message import Figures, Message, because
from fitting.cuffs.cuffs_file import CUFFS_FILE
from fitting.cuffs.wearable_cuff import Cuff
from fitting.errors import FitError
from recordings.errors import RecordingError
from solver.cuff import CuffParameters
from solver.errors import SolverError
from solver.inverse_kinematics.marker_fit import PostureErrors, Vertical
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import CoordinateLock, Model
from solver.osim.model_writer import osim_document
from solver.redundancy.mechanics import glenoid_cone
from solver.stream.frame_muscles import SLACK, StreamScenario
from solver.suit.suit import BUNDLED_SUIT, Suit, read_suit
from station.assessment.assessment_inputs import read_cuffs_to_wear, worn_cuffs
from station.config import LiveSection
from station.errors import StationError
from station.kinematics.ik import with_marker_set
from station.live.published import NAN, LiveScenario
from station.messages.live_messages import LiveCode
from station.sources import BUNDLED, resolve_model
from station.subject.assessed_subject import (
    fit_suit,
    measure_subject,
    read_wearer_trials,
    smooth_subject,
    worn_arm_cuff,
)
from station.subject.subject_file import SUBJECT_FILE, Cord, Subject, read_subject

UNUSABLE = (StationError, FitError, SolverError, RecordingError, OSError)
"""A session that gives no body must not keep the wearer from seeing something: the generic body is solved instead."""


@dataclass(frozen=True, eq=False)
class LiveBody:
    """A model and a suit. marker_names maps recorded labels to the model's markers; errors are those of the postures of
    a measured wearer.
    """

    model: Model
    tasks: TrackingTasks
    suit: Suit
    vertical: Vertical
    marker_names: Mapping[str, str]
    cord: Cord | None
    is_scaled: bool
    findings: tuple[Message[LiveCode], ...] = ()
    errors: PostureErrors | None = None

    @property
    def name(self) -> str:
        return self.model.name

    @property
    def has_glenoid(self) -> bool:
        """Whether the joint force is kept in the socket."""
        try:
            glenoid_cone(self.model)
        except SolverError:
            return False
        return True

    @property
    def osim_text(self) -> str:
        """The model as an OpenSim file; "" for the bundled one."""
        return Xml.tostring(osim_document(self.model), encoding="unicode") if self.is_scaled else ""

    def tasks_for(self, labels: tuple[str, ...]) -> tuple[TrackingTasks, list[int], PostureErrors | None]:
        """The tasks of the markers that these labels have, the column of each, and their errors; may be empty."""
        columns = {self.marker_names.get(label, label): column for column, label in enumerate(labels)}
        kept = [k for k, marker in enumerate(self.tasks.markers) if marker.name in columns]
        markers = tuple(self.tasks.markers[k] for k in kept)
        tasks = replace(self.tasks, markers=markers, weights=self.tasks.weights[kept])
        errors = self.errors.for_markers(kept) if self.errors else None
        return tasks, [columns[marker.name] for marker in markers], errors


def live_body(folder: Path, settings: LiveSection, before_utc_ns: int) -> LiveBody:
    """The body for a trial of this session that begins at before_utc_ns: later trials must not change it.

    Raises SolverError for a model or suit of the configuration that cannot be read.
    """
    generic = _unlocked(resolve_model(settings.model or BUNDLED))
    suit = read_suit(settings.suit or BUNDLED_SUIT)
    if settings.model:
        declared = _declared(folder)
        return _generic(generic, suit, declared)
    try:
        declared = read_subject(folder)
        trials = read_wearer_trials(folder, before_utc_ns)
        if not trials:
            return _generic(generic, suit, declared, Message(LiveCode.NO_EARLIER_TRIAL))
        wearer = smooth_subject(measure_subject(declared, trials, generic))
        digitised = fit_suit(wearer, suit)
        return LiveBody(
            model=wearer.model,
            tasks=wearer.posterior.tasks,
            errors=wearer.posterior.errors,
            suit=suit if digitised is None else digitised.suit,
            vertical=declared.vertical,
            marker_names=declared.markers,
            cord=declared.cord,
            is_scaled=True,
        )
    except UNUSABLE as error:
        has_file = (folder / SUBJECT_FILE).exists()
        cause = error if has_file else Message(LiveCode.NO_SUBJECT, {"file": SUBJECT_FILE})
        return _generic(generic, suit, _declared(folder), cause)


def live_scenarios(
    folder: Path | None, settings: LiveSection, body: LiveBody
) -> tuple[dict[str, StreamScenario], tuple[LiveScenario, ...]]:
    """Scenarios that are solved together: slack, worn and rigid, further rest lengths of the worn one, another cuff.

    folder None leaves out the cuffs of the session. Without fitted cuffs there is no "worn". Raises InputError or
    FitError for cuffs that cannot be worn.
    """
    cuffs, waist, arm = _cuffs(folder, settings, body.cord)
    declared = settings.rest_length_m or (body.cord.rest_length_m if body.cord else None)
    rest = declared or body.suit.reference_rest_length
    scenarios = {"slack": StreamScenario(SLACK)}
    if arm is not None:
        scenarios["worn"] = StreamScenario(rest, "both", waist, arm)
    scenarios["rigid"] = StreamScenario(rest)
    worn = scenarios.get("worn", scenarios["rigid"])
    for length in settings.rest_lengths_m:
        scenarios[f"{length:.3f} m"] = replace(worn, rest_length=float(length))
    if settings.other_cuff:
        other = _arm_cuff(cuffs, settings.other_cuff)
        scenarios[settings.other_cuff] = StreamScenario(rest, "both", waist, other)
    return scenarios, tuple(_described(name, scenario) for name, scenario in scenarios.items())


def _described(name: str, scenario: StreamScenario) -> LiveScenario:
    if not np.isfinite(scenario.rest_length):
        return LiveScenario(name, "slack", NAN)
    return LiveScenario(name, scenario.condition, scenario.rest_length, scenario.arm.name if scenario.arm else "")


def _cuffs(
    folder: Path | None, settings: LiveSection, cord: Cord | None
) -> tuple[dict[str, Cuff], CuffParameters | None, CuffParameters | None]:
    """All fitted cuffs, the waist cuff, and the arm cuff that is worn; nothing without a file."""
    path = settings.cuffs or (folder / CUFFS_FILE if folder else None)
    if path is None or (settings.cuffs is None and not path.exists()):
        return {}, None, None
    cuffs = read_cuffs_to_wear(path)
    waist = next((cuff for cuff in cuffs.values() if cuff.site == "waist"), None)
    arms = [name for name, cuff in cuffs.items() if cuff.site == "arm"]
    name = worn_arm_cuff(settings.arm_cuff or (cord.cuff if cord else None), arms)
    worn = worn_cuffs({waist.name: waist}, ())[0] if waist else None
    return cuffs, worn, _arm_cuff(cuffs, name) if name else None


def _arm_cuff(cuffs: dict[str, Cuff], name: str) -> CuffParameters:
    """Raises InputError for a cuff that was not fitted."""
    found = worn_cuffs({key: cuff for key, cuff in cuffs.items() if cuff.site == "arm"}, (name,))
    return next(cuff for cuff in found if cuff.name == name)


def _generic(
    generic: Model, suit: Suit, declared: Subject | None, cause: Exception | Message[LiveCode] | None = None
) -> LiveBody:
    """The body without the wearer's measurements, and the cause; a model of the configuration has none."""
    model, names, _ = with_marker_set(generic, declared.marker_set if declared else "")
    markers = tuple(marker for marker in model.markers if marker.name in names)
    finding = cause and Message(LiveCode.GENERIC_BODY, {"model": model.name, **_reason(cause)})
    return LiveBody(
        model=model,
        tasks=TrackingTasks(markers, np.ones(len(markers))),
        suit=suit,
        vertical=declared.vertical if declared else "z",
        marker_names=declared.markers if declared else {},
        cord=declared.cord if declared else None,
        is_scaled=finding is None,
        findings=(finding,) if finding else (),
    )


def _reason(cause: Exception | Message[LiveCode]) -> Figures:
    """The cause, with the file that an error of the system is about."""
    figures = because(cause)
    if isinstance(cause, OSError) and cause.filename is not None:
        return {**figures, "reason": f"{cause.filename}: {figures['reason']}"}
    return figures


def _declared(folder: Path) -> Subject | None:
    try:
        return read_subject(folder)
    except StationError:
        return None


def _unlocked(model: Model) -> Model:
    """Locks of a published model hold coordinates that markers are to determine."""
    return replace(model, constraints=tuple(c for c in model.constraints if not isinstance(c, CoordinateLock)))
