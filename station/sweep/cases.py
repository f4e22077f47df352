"""A plan's cases: every file read once, each case named by the content of all that decides its result."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from importlib import metadata, resources
from pathlib import Path
from typing import Any

import numpy as np

from documents.regular_file import LARGEST_TABLE, read_regular
from fitting.wearable_cuff import WearableCuff
from solver.cuff import CuffParameters, by_site
from solver.model import Model, ModelError
from solver.motion import MotionError, differentiate
from solver.osim.loads import data_file
from solver.point_mass import with_point_mass
from solver.suit.scenarios import SuitScenario
from solver.suit.suit import BUNDLED_SUIT, PARTS, Suit, read_suit
from station.assessment.assessment_inputs import cuff_remarks, read_cuffs_to_wear, worn_cuffs
from station.assessment.sources import BUNDLED, loads_of, model_of, motion_of
from station.sweep.plan import NONE, PlanError, Point, SweepPlan, Value
from station.sweep.solving import Geometry, Task, WornCase

FRAMES_PER_TASK = 100_000
"""Of all scenarios of a task: seconds of work, which is what a killed worker loses."""

GEOMETRY = ("model", "motion", "external_loads", "hand_mass_kg", "suit")
"""What cases share that go through the same postures in the same masses."""


@dataclass(frozen=True, eq=False)
class Case:
    """number in the plan's order, its point of the design, and a key that is the same only for the same result."""

    number: int
    point: Point
    worn: WornCase
    remarks: str

    @property
    def key(self) -> str:
        return self.worn.key


class SweepInputs:
    """Reads what a plan names. Raises PlanError, or what its readers raise, for files that cannot be used."""

    def __init__(self, plan: SweepPlan) -> None:
        self.plan, self.solver = plan, _solver_digest()
        self.model, self.suit, self.cuffs = cache(self._model), cache(self._suit), cache(self._cuffs)
        self.digest = cache(self._digest)
        for each in plan.values("model"):
            self.model(each)
        self.cases = [self._case(number, point) for number, point in enumerate(plan.points())]

    def tasks(self, cases: Sequence[Case]) -> Iterator[Task]:
        """Cases of one geometry together, as many as make a task; motions are read when it is their turn."""
        groups: dict[tuple[Value, ...], dict[str, WornCase]] = {}
        for case in cases:
            groups.setdefault(tuple(case.point[axis] for axis in GEOMETRY), {})[case.key] = case.worn
        for named, group in groups.items():
            geometry = self._geometry(dict(zip(GEOMETRY, named, strict=True)))
            worn = list(group.values())
            frames = 1 if isinstance(geometry, str) else len(geometry.kinematics.time[:: self.plan.every])
            size = max(1, FRAMES_PER_TASK // (frames * max(len(each.scenario.rest_lengths) for each in worn)))
            for first in range(0, len(worn), size):
                yield Task(geometry, self.plan.every, tuple(worn[first : first + size]))

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
            "files": [self.digest(axis, point[axis]) for axis in ("model", "motion", "external_loads", "suit")],
            "hand_mass": point["hand_mass_kg"],
            "cord": [suit.stiffness, *(getattr(suit, part).location.tolist() for part in PARTS)],
            "rest_lengths": lengths.tolist(),
            "condition": scenario.condition,
            "cuffs": [cuff and [cuff.stiffness, cuff.damping, cuff.migration] for cuff in scenario.cuffs],
        }
        key = hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()
        fits = self.cuffs(point["cuffs"])
        remarks = cuff_remarks(self._path(point["cuffs"]), (fits[cuff.name] for cuff in scenario.cuffs if cuff))
        return Case(number, point, WornCase(key, suit, scenario), "; ".join(remarks))

    def _worn_cuffs(self, point: Point) -> tuple[CuffParameters | None, CuffParameters | None]:
        """Those at waist and arm; none is worn in the rigid condition."""
        fits = self.cuffs(point["cuffs"])
        worn = worn_cuffs(fits, (str(point["cuff"]),))
        arms, waists = by_site(worn)
        if len(arms) != 1 or len(waists) > 1:
            raise PlanError(
                f"a case wears one arm cuff and at most one at the waist, and with {point['cuff']} of {point['cuffs']} "
                f"it would wear {', '.join(f'{cuff.name} ({cuff.site})' for cuff in worn)}; name an arm cuff"
            )
        return (None, None) if point["condition"] == "rigid" else (waists[0] if waists else None, arms[0])

    def _geometry(self, named: Point) -> Geometry | str:
        """Or the sentence why there is none."""
        try:
            model, motion, loads = self.model(named["model"]), named["motion"], named["external_loads"]
            kinematics = differentiate(motion_of(None if motion == BUNDLED else self._path(motion), model))
            return Geometry(
                model=_with_mass_in_hand(model, float(str(named["hand_mass_kg"]))),
                kinematics=kinematics,
                loads=loads_of(None if loads == NONE else self._path(loads), model, kinematics.time),
            )
        except (ModelError, MotionError) as error:
            return str(error)

    def _model(self, name: Value) -> Model:
        return model_of(BUNDLED if name == BUNDLED else str(self._path(name)))

    def _suit(self, name: Value) -> Suit:
        return read_suit(BUNDLED_SUIT if name == BUNDLED else self._path(name))

    def _cuffs(self, name: Value) -> dict[str, WearableCuff]:
        return read_cuffs_to_wear(self._path(name), tuple(map(str, self.plan.values("cuff"))))

    def _path(self, name: Value) -> Path:
        return self.plan.folder / str(name)

    def _digest(self, axis: str, name: Value) -> str:
        """SHA-256 of what a file holds; what is bundled is part of the solver."""
        sources = [] if name in (BUNDLED, NONE) else [self._path(name)]
        try:
            if axis == "external_loads" and sources:
                sources.append(data_file(self._path(name)))
            return hashlib.sha256(b"".join(read_regular(source, LARGEST_TABLE) for source in sources)).hexdigest()
        except OSError as error:
            raise PlanError(
                f"the plan's vary.{axis} names {name}, which cannot be read ({error.strerror}); paths are relative to "
                "the plan"
            ) from error


def _solver_digest() -> str:
    """SHA-256 of the solver's own files: where it is being developed it changes and its version does not."""
    root = Path(str(resources.files("solver")))
    digest = hashlib.sha256()
    for path in sorted(path for suffix in ("py", "toml") for path in root.rglob(f"*.{suffix}")):
        digest.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes() + b"\0")
    return digest.hexdigest()


def _changed(suit: Suit, point: Point) -> Suit:
    """The suit with what the point has for its cord."""
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
    """[kg], at the hand's own mass centre."""
    if not mass:
        return model
    return with_point_mass(model, "hand", mass, model.bodies[model.body_index("hand")].mass_center)
