"""Functions of the public package that solve, apart from library.py, because they load numba and its compiler."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from numbers import Real
from os import PathLike
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING, get_args

import numpy as np
from numpy.typing import ArrayLike

from documents.regular_file import ensure_path
from fitting.cuffs.cuff_tables import CuffsLike, cuffs_by_name
from solver.checks import ensure_at_least, ensure_known, ensure_names, ensure_type
from solver.cuff import by_site
from solver.errors import SolverCode
from solver.inverse_kinematics.solve import TrackingTasks
from solver.model import Model, ModelError
from solver.motion import Kinematics, decimate
from solver.multibody.loads import ExternalForce
from solver.redundancy.effort import RedundancyOptions, options_for
from solver.redundancy.motion_solution import LoadedMotion, MotionSolution
from solver.stream.frame_muscles import StreamScenario
from solver.stream.stream_solver import DEFAULT_LAG, StreamSolver
from solver.suit.assessment import Assessment
from solver.suit.assessment import assess as assess_suit
from solver.suit.cord import Condition
from solver.suit.scenarios import ensure_all_frames
from solver.suit.suit import BUNDLED_SUIT, Suit, SuitError, read_suit
from station.assessment.assessment_inputs import cuff_findings, worn_cuffs
from station.assessment.budget_file import read_budget
from station.assessment.case import AssessedCase
from station.assessment.findings import Finding
from station.assessment.findings import findings as assessment_findings
from station.assessment.given_motion import load_checks, motion_checks, motion_findings
from station.assessment.people_run import PeopleRun, SourceChoice, assess_people
from station.assessment.rmr import ensure_distinct_controls, left_out_findings, solve_and_check
from station.defaults import CUTOFF_HZ, LEAST_DRAWS
from station.sources import BUNDLED, resolve_kinematics, resolve_loads, resolve_model

if TYPE_CHECKING:
    import pandas as pd

File = Path | str


def load_model(source: File = BUNDLED, *, actuators: Sequence[File] = (), ignore_forces: bool = False) -> Model:
    """Read an OpenSim model (.osim), or the bundled thoracoscapular one.

    actuators: files of OpenSim with a ForceSet that is added to the model, such as residuals of a free pelvis and
    reserves of its joints. ignore_forces: leave out forces and controllers that the solver does not have; left_out of
    the model names them. Raises ModelError.
    """
    ensure_names("actuators", actuators)
    paths = [ensure_path("actuators", path) for path in actuators]
    return resolve_model(str(ensure_path("source", source)), ignore_forces=ignore_forces, actuators=paths)


def load_motion(
    model: Model, path: File | pd.DataFrame | None = None, cutoff_hz: float | None = CUTOFF_HZ, every: int = 1
) -> Kinematics:
    """Read a motion (.mot, .sto, .csv) and differentiate it; without a path, the bundled raise of the arm.

    In place of a path, a DataFrame with the column time [s] and columns named as coordinates [rad, m]; attrs["units"]
    may name other units (deg, mm), and Kinematics.to_dataframe() is such a table. cutoff_hz: of the low-pass filter
    (Butterworth of order 4, forwards and backwards), None for no filter. every: keep every n-th frame. Uneven steps are
    interpolated to even ones, and a coordinate without a column keeps its default or is where a constraint holds it.
    The findings of the result say so, as the terminal does. Raises MotionError, and ModelError for an n below 1.
    """
    _ensure_model(model)
    ensure_type("cutoff_hz", cutoff_hz, (Real, NoneType), "a number or None")
    if isinstance(path, str | PathLike):
        path = Path(path)
    elif path is not None:
        import pandas as pd

        ensure_type("path", path, pd.DataFrame, "a path or a DataFrame of pandas")
    kinematics = resolve_kinematics(path, model, cutoff_hz)
    findings = tuple(motion_findings(motion_checks(model, kinematics)))
    units = {coordinate.name: "m" if coordinate.motion == "translation" else "rad" for coordinate in model.coordinates}
    return replace(decimate(kinematics, every), findings=findings, units=units)


def solve_motion(
    model: Model, kinematics: Kinematics, options: RedundancyOptions | None = None, external_loads: File | None = None
) -> MotionSolution:
    """Solve the muscle-redundancy problem of every frame: activations, forces and joint reactions.

    Equations: Belli et al. 2023 (solver/redundancy/problem.py). A frame that cannot be solved has its outcome and NaN.
    A model without a shoulder has no glenoid constraint. external_loads: OpenSim's ExternalLoads (.xml). The findings
    of the result are those on motion and loads, on parts of the model that are left out, on muscles that cannot pull,
    and on reserves and residuals that are large. Raises ModelError, MotionError.
    """
    _ensure_model(model)
    _ensure_kinematics(kinematics)
    ensure_distinct_controls(model)
    loads, on_inputs = _loads(external_loads, model, kinematics)
    options = options_for(model, _options(options))
    motion = LoadedMotion(model, kinematics, loads, options)
    solved = solve_and_check(motion, model, has_external_loads=external_loads is not None)
    return replace(solved.solution, findings=(*on_inputs, *solved.findings))


def open_stream(
    markers: Sequence[str] | Mapping[str, float],
    model: Model | None = None,
    rest_lengths: Mapping[str, float] | None = None,
    cuffs: CuffsLike | None = None,
    suit: File | None = None,
    *,
    lag_s: float = DEFAULT_LAG,
    soft_tissue_m: float | None = None,
    options: RedundancyOptions | None = None,
) -> StreamSolver:
    """Solve markers frame by frame: posture, muscles and joint force of the frame of lag_s ago (docs/live.md).

    markers: names in the order of the positions that are pushed, or name → weight. rest_lengths: name of a scenario →
    rest length of the cord [m]; "slack" is always solved. cuffs: an arm cuff and a waist cuff that all scenarios wear,
    with migration and compliance; rigid ones where there is none. soft_tissue_m: standard deviation along each axis [m]
    of a marker's place on its body, 0 for markers on bone, None for the published size. Raises NotIdentified,
    ModelError, SuitError.
    """
    if isinstance(markers, str) or not isinstance(markers, Iterable):
        found = type(markers).__name__
        raise TypeError(f"markers should be names, or a mapping from names to weights, and got a {found}")
    model = model or load_model()
    _ensure_model(model)
    weights = dict(markers) if isinstance(markers, Mapping) else dict.fromkeys(markers, 1.0)
    _ensure_numbers("markers", weights)
    _ensure_numbers("rest_lengths", rest_lengths or {})
    ensure_type("lag_s", lag_s, Real, "a number")
    ensure_type("soft_tissue_m", soft_tissue_m, (Real, NoneType), "a number or None")
    if not weights:
        raise ModelError("markers is empty, expected names of markers of the model; give them", SolverCode.WRONG_OPTION)
    tasks = TrackingTasks(tuple(model.marker(name) for name in weights), np.array(list(weights.values())))
    arms, waists = by_site(worn_cuffs({} if cuffs is None else cuffs_by_name(cuffs), ()))
    if len(arms) > 1 or len(waists) > 1:
        named = ", ".join(cuff.name for cuff in (*arms, *waists))
        raise SuitError(f"a suit has one cuff at the arm and one at the waist, got {named}", SolverCode.WRONG_CUFF)
    arm, waist = next(iter(arms), None), next(iter(waists), None)
    condition: Condition = "both" if arm or waist else "rigid"
    scenarios = {"slack": StreamScenario()} | {
        name: StreamScenario(length, condition, waist, arm) for name, length in (rest_lengths or {}).items()
    }
    return StreamSolver(
        model, tasks, scenarios, suit=_suit(suit), options=_options(options), lag_s=lag_s, soft_tissue_m=soft_tissue_m
    )


def assess(  # noqa: PLR0913 (a notebook names what it changes)
    cuffs: CuffsLike,
    model: Model | None = None,
    kinematics: Kinematics | None = None,
    suit: File | None = None,
    *,
    rest_lengths: ArrayLike | None = None,
    reference_rest_length: float | None = None,
    people: int | None = None,
    sources: SourceChoice = "all",
    most_frames: int | None = None,
    options: RedundancyOptions | None = None,
    external_loads: File | None = None,
) -> Assessment:
    """Assess a suit with these cuffs in a motion: muscle effort over the rest length of the cord, in four conditions.

    The conditions are rigid cuffs, migration, compliance, and both. Default: the bundled model and motion. cuffs: as
    cuffs_by_name() takes them: cuffs or fits, mappings, a DataFrame, or the path of a cuffs.json. rest_lengths [m] and
    reference_rest_length [m] replace those of the suit; activations() of the result is at the latter. people: number of
    people drawn for intervals and the decision, at least 40, or 0 for none; None: as the bundled budget, and 0 with
    elastic tendons. sources: "all" of the budget, or "cuffs" for the noise of their fit alone. most_frames: limit of
    the frames that are solved; external_loads: OpenSim's ExternalLoads (.xml). The findings of the result are those
    that `station assess` prints; its uncertainty.decisions are the decision. Raises FitError for cuffs that cannot be
    worn, ModelError, SuitError.
    """
    fits = cuffs_by_name(cuffs)
    ensure_known("sources", sources, get_args(SourceChoice))
    if people is not None:
        ensure_at_least("people", people, LEAST_DRAWS if people else 0)
    worn = worn_cuffs(fits, ())
    model = model or load_model()
    _ensure_model(model)
    kinematics = kinematics or load_motion(model)
    _ensure_kinematics(kinematics)
    every = 1
    if most_frames is not None:
        ensure_at_least("most_frames", most_frames, 1)
        every = math.ceil(len(kinematics.time) / most_frames)
    loads, on_inputs = _loads(external_loads, model, kinematics)
    motion = LoadedMotion(model, kinematics, loads, _options(options))
    case = AssessedCase(model, kinematics, _with_lengths(_suit(suit), rest_lengths, reference_rest_length))
    found = assess_suit(motion, case.suit, worn, every=every)
    budget = read_budget(people=people)
    are_drawn = bool(budget.sample.people) and not (people is None and motion.options.tendons == "elastic")
    if are_drawn:
        ensure_all_frames(motion.options, budget.sample.frames)
        found, _ = assess_people(PeopleRun(budget, sources=sources), case, motion, worn, found)
    on_suit = assessment_findings(found, are_people_drawn=are_drawn) + cuff_findings(fits.values())
    return replace(found, findings=(*on_suit, *on_inputs, *left_out_findings(model, None)))


def _loads(
    external_loads: File | None, model: Model, kinematics: Kinematics
) -> tuple[tuple[ExternalForce, ...], list[Finding]]:
    """The loads, and the findings on them and on the motion."""
    path = None if external_loads is None else ensure_path("external_loads", external_loads)
    loads = resolve_loads(path, model, kinematics.time)
    return loads, motion_findings(motion_checks(model, kinematics) | load_checks(path, loads, model, kinematics))


def _suit(path: File | None) -> Suit:
    """The suit of a file, or the bundled one. Raises SuitError."""
    return read_suit(BUNDLED_SUIT if path is None else ensure_path("suit", path))


def _with_lengths(suit: Suit, rest_lengths: ArrayLike | None, reference: float | None) -> Suit:
    """The suit with other rest lengths [m]. Raises SuitError."""
    lengths = np.asarray(suit.rest_lengths if rest_lengths is None else rest_lengths)
    if lengths.dtype.kind not in "iuf":
        raise TypeError(f"rest_lengths should be numbers, and got a {type(rest_lengths).__name__}")
    ensure_type("reference_rest_length", reference, (Real, NoneType), "a number or None")
    reference = suit.reference_rest_length if reference is None else float(reference)
    lengths = np.unique(lengths.astype(float))
    for name, values in (("rest_lengths", lengths), ("reference_rest_length", np.array([reference]))):
        if not values.size or not ((values > 0.0) & (values < np.inf)).all():
            raise SuitError(f"{name} should be lengths above 0 m, and is {values}; give them in m", SolverCode.SUIT_KEY)
    return replace(suit, rest_lengths=lengths, reference_rest_length=reference)


def _ensure_model(model: object) -> None:
    ensure_type("model", model, Model, "a Model, as load_model(…) returns")


def _ensure_kinematics(kinematics: object) -> None:
    ensure_type("kinematics", kinematics, Kinematics, "a Kinematics, as load_motion(…) returns")


def _options(options: RedundancyOptions | None) -> RedundancyOptions:
    """The options, or the default ones. Raises TypeError for another type."""
    options = RedundancyOptions() if options is None else options
    ensure_type("options", options, RedundancyOptions, "RedundancyOptions or None")
    return options


def _ensure_numbers(argument: str, values: Mapping[str, float]) -> None:
    """Raise TypeError for anything but a mapping from names to numbers."""
    ensure_type(argument, values, Mapping, "a mapping from names to numbers")
    for value in values.values():
        ensure_type(argument, value, Real, "a mapping from names to numbers")
