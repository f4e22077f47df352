"""Assess drawn people in tasks that are kept: an interrupted run continues, on this computer or a Dask cluster."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from documents.message import Message
from solver.cuff import CuffParameters, by_site
from solver.redundancy.motion_solution import LoadedMotion
from solver.suit.assessment import Assessment
from solver.suit.scenarios import CurveReadouts, Place, stacked
from solver.suit.suit import suit_toml
from solver.uncertainty.factors import normal_scores, unit_sample
from solver.uncertainty.indices import group_names, group_sample, sobol_indices
from solver.uncertainty.people import PeopleCase, solve_people
from solver.uncertainty.sources import DonningSpread
from solver.uncertainty.total import DrawnPeople, explained_figures, mark_infeasible, with_people
from station.assessment.budget_file import BUNDLED_BUDGET, UncertaintyBudget, read_budget
from station.assessment.case import AssessedCase
from station.checksums import drafted
from station.errors import StationError, UnusedOption
from station.messages.assessment_messages import InputCode
from station.progress import Progress, silent, with_part
from station.sources import named_hash
from station.versions import solver_digest

if TYPE_CHECKING:
    from distributed import Client

Array = NDArray[np.float64]
Readouts = dict[Place, CurveReadouts]

SourceChoice = Literal["all", "cuffs"]
PEOPLE_PER_TASK = 25
"""Some seconds of work, which is lost if the run is interrupted."""
PARTS_FOLDER = "uncertainty"


class PeopleError(StationError):
    """Drawn people that could not be assessed."""


@dataclass(frozen=True, eq=False)
class PeopleTask:
    """Scores (people, scores) to solve; key: hash of everything that determines the result."""

    case: PeopleCase
    scores: Array
    key: str


Solve = Callable[[Sequence[PeopleTask]], Iterator[tuple[str, Readouts]]]
"""Tasks → key and readouts of each as it ends."""


def solve_people_task(task: PeopleTask, workers: int | None = 1) -> Readouts:
    """Solve a task on a worker, which is one of several: with one thread."""
    return solve_people(task.case, task.scores, workers=workers)


def solve_here(tasks: Sequence[PeopleTask]) -> Iterator[tuple[str, Readouts]]:
    """Solve in this process, with a thread per processor."""
    return ((task.key, solve_people_task(task, workers=None)) for task in tasks)


@dataclass(frozen=True, eq=False)
class PeopleRun:
    """Design of the drawn people, and folder of finished tasks; None keeps nothing.

    sources: all of the budget, or the noise of the cuffs' fit alone
    source: the file of the budget;  index_blocks: blocks of the sample for Sobol indices, 0 for none
    donnings: session folders with repeated donnings, besides those of the assessed cuffs
    """

    budget: UncertaintyBudget
    folder: Path | None = None
    solve: Solve = solve_here
    source: Path = BUNDLED_BUDGET
    index_blocks: int = 0
    donnings: tuple[Path, ...] = ()
    sources: SourceChoice = "all"

    @property
    def inputs(self) -> dict[str, str]:
        """Role → name and SHA-256 of the budget, or a name alone for the bundled one; names of further sessions."""
        name = "bundled budget of uncertainty" if self.source == BUNDLED_BUDGET else named_hash(self.source)
        further = {"donnings": ", ".join(folder.resolve().name for folder in self.donnings)} if self.donnings else {}
        return {"budget": name, **further}


def assess_people(
    run: PeopleRun,
    assessed: AssessedCase,
    motion: LoadedMotion,
    cuffs: Sequence[CuffParameters],
    assessment: Assessment,
    progress: Progress = silent,
    donning: DonningSpread | None = None,
) -> tuple[Assessment, DrawnPeople | None]:
    """The assessment of the motion with these cuffs, with the intervals of drawn people; as it is where nothing varies.

    donning replaces the spread of the budget.
    """
    sources, sample = run.budget.sources, run.budget.sample
    if donning is not None:
        sources = replace(sources, donning=donning)
    sources = sources if run.sources == "all" else sources.fit_only
    every = max(1, round(len(motion.kinematics.time) / sample.frames))
    arms, waists = by_site(cuffs)
    waist = waists[0] if waists else None
    case = PeopleCase(motion, assessed.suit, waist, tuple(arms), sources, every, assessed.drawn)
    if not case.factors:
        return assessment, None
    unit = unit_sample(case.factors, sample.people, sample.method, sample.seed)
    scores = np.vstack([np.zeros(unit.shape[1]), normal_scores(unit)])
    readouts = mark_infeasible(run_people(case, scores, run, progress), has_assessed=True)
    found = with_people(assessment, readouts, case.every, group_names(case.factors), run.budget.rule)
    people = DrawnPeople(readouts, sample.seed, run.index_blocks)
    if run.index_blocks:
        scores = group_sample(case.factors, run.index_blocks, sample.seed)
        solved = run_people(case, scores, run, with_part(progress, "Sobol indices"))
        sampled = mark_infeasible(solved, has_assessed=False)
        people = replace(people, indices=sobol_indices(case.factors, explained_figures(sampled), sample.seed))
    return found, people


def run_people(case: PeopleCase, scores: Array, run: PeopleRun, progress: Progress = silent) -> Readouts:
    """Readouts (people,) of scores (people, scores), from finished tasks where there are any."""
    described = _description(case)
    tasks = [
        PeopleTask(case, part, hashlib.sha256(described + part.tobytes()).hexdigest())
        for part in np.array_split(scores, max(1, len(scores) // PEOPLE_PER_TASK))
    ]
    found = {task.key: part for task in tasks if (part := _read_part(run.folder, task.key)) is not None}
    done = sum(len(task.scores) for task in tasks if task.key in found)
    sizes = {task.key: len(task.scores) for task in tasks}
    progress("assessing people", done, len(scores))
    for key, part in run.solve([task for task in tasks if task.key not in found]):
        _write_part(run.folder, key, part)
        found[key] = part
        done += sizes[key]
        progress("assessing people", done, len(scores))
    parts = [found[task.key] for task in tasks]
    return {place: stacked([part[place] for part in parts]) for place in parts[0]}


def _description(case: PeopleCase) -> bytes:
    """Everything but the scores that determines a result: solver, model, motion, suit, cuffs, sources."""
    digest = hashlib.sha256(solver_digest().encode())
    for motion in (case.motion.kinematics, *(draw.kinematics for draw in case.drawn)):
        digest.update(motion.time.tobytes() + motion.positions.tobytes())
    for draw in case.drawn:
        digest.update(repr(_plain(draw.scaling)).encode())
    for load in case.motion.loads:
        digest.update(repr(_plain(load)).encode())
    plain: dict[str, Any] = {
        "model": _plain(case.motion.model),
        "options": _plain(case.motion.options),
        "suit": suit_toml(case.suit),
        "cuffs": [_plain(cuff) for cuff in case.cuffs],
        "sources": _plain(case.sources),
        "every": case.every,
    }
    digest.update(json.dumps(plain, sort_keys=True, default=repr).encode())
    return digest.digest()


def _plain(noun: Any) -> Any:
    """A dataclass with everything in it as JSON; arrays by their bytes, other objects by their type."""
    if isinstance(noun, np.ndarray):
        return hashlib.sha256(noun.tobytes()).hexdigest()
    if hasattr(noun, "__dataclass_fields__"):
        return [type(noun).__name__, *(_plain(getattr(noun, field.name)) for field in fields(noun))]
    if isinstance(noun, Mapping):
        return [[_plain(key), _plain(noun[key])] for key in noun]
    if isinstance(noun, (tuple, list)):
        return [_plain(item) for item in noun]
    return noun if isinstance(noun, (str, int, float, bool, type(None))) else type(noun).__name__


def _read_part(folder: Path | None, key: str) -> Readouts | None:
    """A finished task; None for one that is not finished, or whose file is damaged."""
    if folder is None:
        return None
    try:
        with np.load(folder / f"{key}.npz", allow_pickle=False) as part:
            places = [tuple(json.loads(text)) for text in part["places"].tolist()]
            return {
                (condition, cuff): CurveReadouts(
                    **{field.name: part[f"{index}.{field.name}"] for field in fields(CurveReadouts)}
                )
                for index, (condition, cuff) in enumerate(places)
            }
    except (OSError, KeyError, ValueError, EOFError):
        return None


def _write_part(folder: Path | None, key: str, readouts: Readouts) -> None:
    if folder is None:
        return
    folder.mkdir(parents=True, exist_ok=True)
    arrays = {
        f"{index}.{field.name}": getattr(reading, field.name)
        for index, reading in enumerate(readouts.values())
        for field in fields(CurveReadouts)
    }
    with drafted(folder / f"{key}.npz") as draft, draft.open("wb") as file:
        np.savez(file, places=np.array([json.dumps(place) for place in readouts]), **arrays)


@dataclass(frozen=True)
class PeopleOptions:
    """Options of the command line; people: 0 for none, None for those of the budget; workers: processes of this
    computer.
    """

    people: int | None = None
    sources: SourceChoice = "all"
    budget: Path | None = None
    index_blocks: int | None = None
    scheduler: str | None = None
    workers: int | None = None
    donnings: tuple[Path, ...] = ()

    @property
    def is_kept(self) -> bool:
        """Whether finished tasks are kept: those of the default take a few seconds."""
        return (self.people, self.budget, self.index_blocks) != (None, None, None)


@contextmanager
def people_run(output: Path, options: PeopleOptions) -> Iterator[PeopleRun | None]:
    """The run of these options, None if no people are to be drawn; local processes end with the block.

    Raises UnusedOption for options of drawn people without any.
    """
    source = options.budget or BUNDLED_BUDGET
    budget = read_budget(source, options.people)
    if not budget.sample.people:
        if (options.scheduler, options.workers, options.index_blocks, options.donnings) != (None, None, None, ()):
            raise UnusedOption(Message(InputCode.NO_PEOPLE))
        yield None
        return
    run = PeopleRun(
        budget,
        output / PARTS_FOLDER if options.is_kept else None,
        source=source,
        index_blocks=options.index_blocks or 0,
        donnings=options.donnings,
        sources=options.sources,
    )
    scheduler, workers = options.scheduler, options.workers
    if scheduler is None and workers is None:
        yield run
        return
    from station.dask_cluster import connected  # needs the extra

    with connected(scheduler, workers or 1) as client:
        yield replace(run, solve=partial(solve_people_on, client))


def solve_people_on(client: Client, tasks: Sequence[PeopleTask]) -> Iterator[tuple[str, Readouts]]:
    """Raises PeopleError for a task that ends in an error or kills its workers; the finished ones are kept."""
    from station.dask_cluster import completed_tasks

    for task, future in completed_tasks(client, solve_people_task, tasks):
        error = future.exception()
        if error is not None:
            raise PeopleError(Message(InputCode.PEOPLE_FAILED, {"reason": f"{type(error).__name__}: {error}"}))
        yield task.key, future.result()
