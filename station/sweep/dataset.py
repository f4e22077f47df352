"""Run a sweep: solve the cases that are not finished, and write a table of all cases.

The output is a file per finished case, and at the end a Parquet table of all cases. The key of a case is a hash of
everything that determines its result.

A worker, a process of this machine or of a Dask cluster, evaluates the motion of its task once. It solves the cases one
by one, so that the last bit of a result does not depend on the other cases of the task.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, lru_cache
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np
from distributed import Client

from documents.message import Message, because
from documents.plain_data import PlainDataError, read_json
from documents.regular_file import LARGEST_TABLE, read_regular
from fitting.cuffs.wearable_cuff import Cuff
from solver.cuff import CuffParameters, by_site
from solver.errors import MotionError, SolverError
from solver.model import Model, ModelError, with_point_mass
from solver.motion import Kinematics
from solver.multibody.loads import ExternalForce
from solver.osim.loads_document import data_file
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.cord import SuitScenario
from solver.suit.optimise import LEAST_FRAMES
from solver.suit.scenarios import SuitedMotion, find_minimum, prepare_suited_motion, solve_scenarios, solve_without_suit
from solver.suit.suit import BUNDLED_SUIT, PARTS, Suit, SuitError, read_suit
from station.assessment.assessment_inputs import cuff_findings, cuff_remarks, read_cuffs_to_wear, worn_cuffs
from station.assessment.given_motion import load_checks, motion_checks, motion_findings
from station.checksums import drafted, write_whole
from station.dask_cluster import completed_tasks
from station.folders import ensure_folder
from station.messages.study_messages import SweepCode
from station.progress import Progress, silent
from station.sources import BUNDLED, resolve_kinematics, resolve_loads, resolve_model
from station.sweep.sweep_plan import AXES, NONE, PlanError, Point, SweepPlan, Value
from station.versions import solver_digest, solving_versions

Outcome = dict[str, float | str | None]
"""Column → value: the columns of RESULTS, and of ERRORS where the case failed."""
Solve = Callable[[Iterable["Task"]], Iterator[tuple[dict[str, Outcome], bool]]]
"""Tasks → outcomes by key of the cases, and whether they are final; see solve_on."""
TABLE_FILE, PROVENANCE_FILE, PARTS_FOLDER = "sweep.parquet", "sweep.json", "parts"
NAMES = ("model", "motion", "external_loads", "suit", "cuffs", "cuff", "condition")
COUNTS = ("case", "frames", "unsolved")
FRAMES_PER_TASK = 100_000
"""Frames of all scenarios of a task: some seconds of work, which is lost if a worker is killed."""
MOTIONS_IN_MEMORY = 32
"""Of a plan with more, motions are read for their remarks and again for their cases."""
LoadedKinematics = tuple[Kinematics, tuple[ExternalForce, ...]]
GEOMETRY = ("model", "motion", "external_loads", "hand_mass_kg", "suit")
"""Axes whose values cases of one task have in common: the same postures and masses."""
RESULTS = (
    "normalised_cost",
    "reserve_cost",
    "largest_cord_force_n",
    "slack_rest_length_m",
    "optimum_rest_length_m",
    "optimum_normalised_cost",
    "permissible_error_m",
    "bare_body_cost",
    "frames",
    "unsolved",
)
ERRORS = ("error", "error_code")
"""The reason of a case that failed as a sentence, and as a stable code."""


@dataclass(frozen=True)
class SweepResult:
    """The table, and the numbers of cases that failed, were finished by an earlier run, or have unsolved frames.

    first_error  why the first case that failed did so;  findings  on the plan as a whole
    """

    table: Path
    cases: int
    found_finished: int
    failed: int
    unsolved: int
    first_error: str | None = None
    findings: tuple[Message[SweepCode], ...] = ()


def run_sweep(plan: SweepPlan, output: Path, solve: Solve, progress: Progress = silent) -> SweepResult:
    """Run or continue a sweep. A case that fails is a row of the table with the reason.

    After Ctrl-C, a signal or a power failure, the same call continues with the remaining cases. Raises PlanError, or
    the errors of the readers, before the first case is solved.
    """
    ensure_folder(output)
    inputs, parts = SweepInputs(plan), Parts(output)
    write_provenance(output, plan, len(inputs.cases))
    known = {case.key: parts.read(case.key) for case in inputs.cases}
    outcomes = {key: outcome for key, outcome in known.items() if outcome is not None}
    found = sum(case.key in outcomes for case in inputs.cases)
    progress("solving cases", len(outcomes), len(known))
    for solved, is_final in solve(inputs.tasks([case for case in inputs.cases if case.key not in outcomes])):
        for key, outcome in solved.items():
            if is_final:
                parts.write(key, outcome)
            outcomes[key] = outcome
        progress("solving cases", len(outcomes), len(known))
    table = write_table(output, plan, inputs.cases, outcomes)
    rows = [outcomes[case.key] for case in inputs.cases]
    errors = [str(outcome["error"]) for outcome in rows if outcome["error"] is not None]
    return SweepResult(
        table=table,
        cases=len(rows),
        found_finished=found,
        failed=len(errors),
        unsolved=sum(bool(outcome["unsolved"]) for outcome in rows),
        first_error=errors[0] if errors else None,
        findings=_few_frames(plan.every, rows),
    )


def _few_frames(every: int, rows: Sequence[Outcome]) -> tuple[Message[SweepCode], ...]:
    """A finding where the plan leaves fewer frames of a motion than a search for a suit tries."""
    frames = [float(row["frames"]) for row in rows if row["frames"] is not None]
    few = sum(count < LEAST_FRAMES for count in frames)
    if every == 1 or not few:
        return ()
    figures = {"every": every, "cases": few, "fewest": min(frames), "least": LEAST_FRAMES}
    return (Message(SweepCode.FEW_FRAMES, figures),)


class Parts:
    """Finished cases in a folder, one file per case, written atomically under its key."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / PARTS_FOLDER

    def read(self, key: str) -> Outcome | None:
        """The outcome; None for a case that is not finished, or whose file is damaged."""
        try:
            found: Outcome = read_json(self._path(key))
        except (OSError, PlainDataError):
            return None
        return found if isinstance(found, dict) and set(found) == {*RESULTS, *ERRORS} else None

    def write(self, key: str, outcome: Outcome) -> None:
        write_whole(self._path(key), json.dumps(outcome, allow_nan=False) + "\n")

    def _path(self, key: str) -> Path:
        return self.folder / key[:2] / f"{key}.json"


def write_provenance(folder: Path, plan: SweepPlan, cases: int) -> None:
    """Write sweep.json: the plan of this folder, and the versions of the solver."""
    plain = {"plan_sha256": plan.digest, "cases": cases, "versions": solving_versions()}
    write_whole(folder / PROVENANCE_FILE, json.dumps(plain, indent=2) + "\n")


def write_table(folder: Path, plan: SweepPlan, cases: Sequence[Case], outcomes: Mapping[str, Outcome]) -> Path:
    """Write sweep.parquet: a row per case in the order of the plan; equal cases and outcomes give equal bytes."""
    import pyarrow as pa
    from pyarrow import parquet

    rows = [{**_design(case), **outcomes[case.key], "remarks": case.remarks, "key": case.key} for case in cases]
    kinds = {**dict.fromkeys(COUNTS, pa.int64()), **dict.fromkeys([*NAMES, *ERRORS, "remarks", "key"], pa.string())}
    fields = [pa.field(name, kinds.get(name, pa.float64())) for name in rows[0]]
    metadata = {"plan_sha256": plan.digest, "versions": json.dumps(solving_versions())}
    table = pa.Table.from_pylist(rows, schema=pa.schema(fields, metadata=metadata))
    path = folder / TABLE_FILE
    with drafted(path) as draft:
        parquet.write_table(table, draft)
    return path


def _design(case: Case) -> dict[str, Any]:
    """The values of a case, with the parameters of the suit as it is worn."""
    suit = case.worn.suit
    cord: dict[str, float] = {"rest_length_m": suit.reference_rest_length, "stiffness_n_per_m": suit.stiffness}
    for part in PARTS:
        location = getattr(suit, part).location
        cord |= {f"{part}_{axis}_m": float(value) for axis, value in zip("xyz", location, strict=True)}
    axes = {axis: case.point[axis] for axis in AXES if axis in (*NAMES, "hand_mass_kg")}
    return {"case": case.number, **axes, **cord}


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
        kinematics = resolve_kinematics(None if motion == BUNDLED else self._path(motion), body, self.plan.cutoff_hz)
        return kinematics, resolve_loads(None if loads == NONE else self._path(loads), body, kinematics.time)

    def _model(self, name: Value) -> Model:
        return resolve_model(BUNDLED if name == BUNDLED else str(self._path(name)))

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
            figures = {"axis": axis, "file": str(name), **because(error)}
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


@dataclass(frozen=True, eq=False)
class WornCase:
    """Suit and cuffs of a case. The last rest length is the reference of the suit; the others are for the optimum."""

    key: str
    suit: Suit
    scenario: SuitScenario


@dataclass(frozen=True)
class Failure:
    """Reason why a case, or the motion of its task, is not solved."""

    sentence: str
    code: str

    @classmethod
    def of(cls, error: SolverError) -> Failure:
        return cls(str(error), error.code)


@dataclass(frozen=True, eq=False)
class Task:
    """Cases of one motion, or the reason why it cannot be evaluated; their suits differ in the cord only."""

    motion: LoadedMotion | Failure
    every: int
    cases: tuple[WornCase, ...]


def solve_task(task: Task) -> dict[str, Outcome]:
    """Solve the cases of a task. Returns the outcomes by key."""
    motion = task.motion
    if isinstance(motion, Failure):
        return {case.key: failed(motion) for case in task.cases}
    try:
        worn = prepare_suited_motion(motion, task.cases[0].suit, task.every)
        slack, _ = solve_scenarios(worn, [], workers=1)
    except (ModelError, MotionError, SuitError) as error:
        return {case.key: failed(Failure.of(error)) for case in task.cases}
    bare = float(solve_without_suit(worn, slack, workers=1).muscles[0])
    return {case.key: _solved(worn, case, bare) for case in task.cases}


def failed(failure: Failure) -> Outcome:
    return {**dict.fromkeys(RESULTS), "error": failure.sentence, "error_code": failure.code}


def _solved(worn: SuitedMotion, case: WornCase, bare_body_cost: float) -> Outcome:
    """Solve with one thread; there is one worker per core."""
    scenario, suited = case.scenario, worn.with_suit(case.suit)
    try:
        suited.ensure_pulls()
        slack, (effort,) = solve_scenarios(suited, [scenario], workers=1)
    except SuitError as error:
        return failed(Failure.of(error))
    searched = scenario.rest_lengths[:-1]
    lowest = find_minimum(searched, effort.muscles[:-1]) if len(searched) else None
    numbers = (
        effort.muscles[-1],
        effort.reserves[-1],
        effort.cord_force[-1],
        suited.slack_rest_length(scenario),
        *((lowest.rest_length, lowest.cost, lowest.width) if lowest else [np.nan] * 3),
        bare_body_cost,
        effort.outcomes.shape[1],
        effort.unsolved + slack.unsolved,
    )
    plain = [None if np.isnan(number) else float(number) for number in numbers]
    return {**dict(zip(RESULTS, plain, strict=True)), **dict.fromkeys(ERRORS)}


def solve_on(client: Client, tasks: Iterable[Task]) -> Iterator[tuple[dict[str, Outcome], bool]]:
    """Outcomes by key of the cases of every task as it ends, and whether they are final.

    A task whose worker dies is repeated on another one. A task that kills three workers in a row, or ends in an
    unexpected error, gives failed cases that are not final: a later run repeats them.
    """
    for task, future in completed_tasks(client, solve_task, tasks):
        error = future.exception()
        if error is None:
            yield future.result(), True
        else:
            reason = Message(SweepCode.CASE_FAILED, {"reason": f"{type(error).__name__}: {error}"})
            failure = Failure(str(reason), reason.code)
            yield {case.key: failed(failure) for case in task.cases}, False
