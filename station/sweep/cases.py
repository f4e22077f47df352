"""Cases of a plan, with their files; the key of a case is a hash of everything that determines its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from documents.regular_file import LARGEST_TABLE, read_regular
from fitting.cuffs.wearable_cuff import Cuff
from solver.cuff import CuffParameters, by_site
from solver.errors import MotionError
from solver.model import Model, ModelError, with_point_mass
from solver.motion import Kinematics
from solver.multibody.loads import ExternalForce
from solver.osim.loads_document import data_file
from solver.suit.scenarios import LoadedMotion, SuitScenario
from solver.suit.suit import BUNDLED_SUIT, PARTS, Suit, read_suit
from station.assessment.assessment_inputs import cuff_findings, cuff_remarks, read_cuffs_to_wear, worn_cuffs
from station.assessment.motion_checks import load_checks, motion_checks, motion_findings
from station.messages.message import Message
from station.messages.sweep_codes import SweepCode
from station.sources import BUNDLED, kinematics_of, loads_of, model_of
from station.sweep.solving import Failure, Task, WornCase
from station.sweep.sweep_plan import NONE, PlanError, Point, SweepPlan, Value
from station.versions import solver_digest

FRAMES_PER_TASK = 100_000
"""Frames of all scenarios of a task: some seconds of work, which is lost if a worker is killed."""

MOTIONS_IN_MEMORY = 32
"""Of a plan with more, motions are read for their remarks and again for their cases."""

LoadedKinematics = tuple[Kinematics, tuple[ExternalForce, ...]]

GEOMETRY = ("model", "motion", "external_loads", "hand_mass_kg", "suit")
"""Axes whose values cases of one task have in common: the same postures and masses."""


@dataclass(frozen=True, eq=False)
class Case:
    """A case: number in the order of the plan, point of the design, and a key that is unique to its result."""

    number: int
    point: Point
    worn: WornCase
    remarks: str

    @property
    def key(self) -> str:
        return self.worn.key


class SweepInputs:
    """The files of a plan. Raises PlanError, or the errors of the readers, for files that cannot be used."""

    def __init__(self, plan: SweepPlan) -> None:
        self.plan, self.solver = plan, solver_digest()
        self.model, self.suit, self.cuffs = cache(self._model), cache(self._suit), cache(self._cuffs)
        self.digest, self.motion_remarks = cache(self._digest), cache(self._motion_remarks)
        self.loaded_kinematics = lru_cache(MOTIONS_IN_MEMORY)(self._loaded_kinematics)
        for name in plan.values("model"):
            self.model(name)
        self.cases = [self._case(number, point) for number, point in enumerate(plan.points())]

    def tasks(self, cases: Sequence[Case]) -> Iterator[Task]:
        """Group cases of one geometry into tasks; a motion is read when its first task is needed."""
        groups: dict[tuple[Value, ...], dict[str, WornCase]] = {}
        for case in cases:
            groups.setdefault(tuple(case.point[axis] for axis in GEOMETRY), {})[case.key] = case.worn
        for geometry, group in groups.items():
            motion = self._motion(dict(zip(GEOMETRY, geometry, strict=True)))
            worn = list(group.values())
            frames = 1 if isinstance(motion, Failure) else len(motion.kinematics.time[:: self.plan.every])
            size = max(1, FRAMES_PER_TASK // (frames * max(len(case.scenario.rest_lengths) for case in worn)))
            for first in range(0, len(worn), size):
                yield Task(motion, self.plan.every, tuple(worn[first : first + size]))

    def _case(self, number: int, point: Point) -> Case:
        suit = _changed(self.suit(point["suit"]), point)
        lengths = np.array([suit.reference_rest_length])
        if "rest_length_m" not in point:
            lengths = np.append(suit.rest_lengths, lengths)
        waist, arm = self._worn_cuffs(point)
        scenario = SuitScenario(point["condition"], waist, arm, lengths)  # type: ignore[arg-type]  # the plan has checked it
        content = {
            "version": metadata.version("cuffstation"),
            "solver": self.solver,
            "every": self.plan.every,
            "cutoff_hz": self.plan.cutoff_hz,
            "files": [self.digest(axis, point[axis]) for axis in ("model", "motion", "external_loads", "suit")],
            "hand_mass": point["hand_mass_kg"],
            "cord": [suit.stiffness, *(getattr(suit, part).location.tolist() for part in PARTS)],
            "rest_lengths": lengths.tolist(),
            "condition": scenario.condition,
            "cuffs": [cuff and [cuff.stiffness, cuff.damping, cuff.migration] for cuff in scenario.cuffs],
        }
        key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        fits = [self.cuffs(point["cuffs"])[cuff.name] for cuff in scenario.cuffs if cuff]
        remarks = [*cuff_remarks(self._path(point["cuffs"]), fits), *map(str, cuff_findings(fits))]
        remarks += self.motion_remarks(*(point[axis] for axis in GEOMETRY[:3]))
        return Case(number, point, WornCase(key, suit, scenario), "; ".join(remarks))

    def _worn_cuffs(self, point: Point) -> tuple[CuffParameters | None, CuffParameters | None]:
        """Cuffs at waist and arm; None for both in the rigid condition."""
        fits = self.cuffs(point["cuffs"])
        worn = worn_cuffs(fits, (str(point["cuff"]),))
        arms, waists = by_site(worn)
        if len(arms) != 1 or len(waists) > 1:
            names = ", ".join(f"{cuff.name} ({cuff.site})" for cuff in worn)
            figures = {"cuff": str(point["cuff"]), "file": str(point["cuffs"]), "worn": names}
            raise PlanError(Message(SweepCode.WORN_CUFFS, figures))
        return (None, None) if point["condition"] == "rigid" else (waists[0] if waists else None, arms[0])

    def _motion(self, geometry: Point) -> LoadedMotion | Failure:
        """The motion, or the reason why it cannot be used."""
        try:
            kinematics, forces = self.loaded_kinematics(*(geometry[axis] for axis in GEOMETRY[:3]))
            mass = float(str(geometry["hand_mass_kg"]))
            return LoadedMotion(_with_mass_in_hand(self.model(geometry["model"]), mass), kinematics, forces)
        except (ModelError, MotionError) as error:
            return Failure.of(error)

    def _motion_remarks(self, model: Value, motion: Value, loads: Value) -> tuple[str, ...]:
        """Findings on a motion and its loads; none on those that cannot be used, whose cases have an error."""
        if (motion, loads) == (BUNDLED, NONE):
            return ()
        try:
            kinematics, forces = self.loaded_kinematics(model, motion, loads)
        except (ModelError, MotionError):
            return ()
        body, path = self.model(model), None if loads == NONE else self._path(loads)
        notes = motion_checks(body, kinematics) | load_checks(path, forces, body, kinematics)
        return tuple(map(str, motion_findings(notes)))

    def _loaded_kinematics(self, model: Value, motion: Value, loads: Value) -> LoadedKinematics:
        body = self.model(model)
        kinematics = kinematics_of(None if motion == BUNDLED else self._path(motion), body, self.plan.cutoff_hz)
        return kinematics, loads_of(None if loads == NONE else self._path(loads), body, kinematics.time)

    def _model(self, name: Value) -> Model:
        return model_of(BUNDLED if name == BUNDLED else str(self._path(name)))

    def _suit(self, name: Value) -> Suit:
        return read_suit(BUNDLED_SUIT if name == BUNDLED else self._path(name))

    def _cuffs(self, name: Value) -> dict[str, Cuff]:
        return read_cuffs_to_wear(self._path(name), tuple(map(str, self.plan.values("cuff"))))

    def _path(self, name: Value) -> Path:
        return self.plan.folder / str(name)

    def _digest(self, axis: str, name: Value) -> str:
        """SHA-256 of a file; bundled files are part of the solver."""
        sources = [] if name in (BUNDLED, NONE) else [self._path(name)]
        try:
            if axis == "external_loads" and sources:
                sources.append(data_file(self._path(name)))
            return hashlib.sha256(b"".join(read_regular(source, LARGEST_TABLE) for source in sources)).hexdigest()
        except OSError as error:
            figures = {"axis": axis, "file": str(name), "reason": str(error.strerror)}
            raise PlanError(Message(SweepCode.FILE_UNREADABLE, figures)) from error


def _changed(suit: Suit, point: Point) -> Suit:
    """The suit with the parameters of the point."""
    changes: dict[str, Any] = {
        part: replace(getattr(suit, part), location=np.array(point[f"{part}_point_m"]))
        for part in PARTS
        if f"{part}_point_m" in point
    }
    if "rest_length_m" in point:
        changes["reference_rest_length"] = point["rest_length_m"]
    if "stiffness_n_per_m" in point:
        changes["stiffness"] = point["stiffness_n_per_m"]
    return replace(suit, **changes)


def _with_mass_in_hand(model: Model, mass: float) -> Model:
    """Add a point mass [kg] at the centre of mass of the hand."""
    if not mass:
        return model
    return with_point_mass(model, "hand", mass, model.bodies[model.body_index("hand")].mass_center)
