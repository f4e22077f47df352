"""Inverse kinematics against OpenSim's own tool, at an accuracy at which it comes near the optimum."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from numpy.typing import NDArray

from recordings.exchange.sample_tables import MarkerTable
from recordings.exchange.trc import read_trc, write_trc
from solver.inverse_kinematics.solve import (
    InverseKinematics,
    PostureOutcome,
    TrackingTasks,
    posture_uncertainty,
    solve_inverse_kinematics,
)
from solver.model import Array, Model
from solver.osim.model_reader import read_osim
from solver.osim.tool_setups import CoordinateTask, IkSetup, ik_setup_document, read_ik_setup
from solver.time_series_table import read_table
from tests.solver.inverse_kinematics.marked import cost_of, gaps_of
from tests.solver.oracle.two_bodies import opensim
from tests.solver.references import NO_WEIGHT, SHARED

pytestmark = [pytest.mark.oracle, pytest.mark.shared]

ACCURACY = 1e-9
BARRIER = 1e-10
"""m²; what OpenSim's interior point leaves of the cost for each coordinate at its bound."""
MARKERS, SUBJECT = SHARED / "markers", SHARED / "subject"
FRAMES = 12


@pytest.mark.parametrize("end_s", [0.1, pytest.param(0.3, marks=pytest.mark.slow)])
@pytest.mark.parametrize("name", ["FLX01", "SHRUG01", "S8R side", "S8R back"])
def test_the_optimum_is_that_of_opensim_and_not_above_it(name: str, end_s: float, tmp_path: Path) -> None:
    trial = tracked(TRIALS[name], end_s)
    theirs = solved_by_opensim(TRIALS[name], trial.model, tmp_path, ACCURACY, end_s)
    found = trial.solve()
    assert set(found.outcomes) == {PostureOutcome.SOLVED}
    away = np.abs(found.coordinates - theirs).max(axis=1)
    assert away.max() < 2e-5
    assert np.median(away) < 1e-6
    assert found.gap.max() < 1e-10
    assert (found.cost - cost_of(trial.model, trial.tasks, trial.observed, theirs)).max() < 1e-8
    assert np.abs(gaps_of(trial.model, found.coordinates)).max() < 1e-10


@pytest.mark.parametrize("seed", [1, 9, *(pytest.param(seed, marks=pytest.mark.slow) for seed in (3, 13))])
def test_the_optimum_of_a_varied_trial_is_not_above_opensims(seed: int, tmp_path: Path) -> None:
    """OpenSim stays off a bound: where a coordinate is at one, costs are compared, and postures elsewhere."""
    files = varied(seed, tmp_path)
    trial = tracked(files)
    theirs = solved_by_opensim(files, trial.model, tmp_path, ACCURACY)
    found = trial.solve()
    assert set(found.outcomes) == {PostureOutcome.SOLVED}
    assert found.gap.max() < 1e-10
    above = cost_of(trial.model, trial.tasks, trial.observed, theirs) - found.cost
    assert above.min() > -1e-12
    at_bound = count_bounds(trial.model, found.coordinates)
    assert (above < 1e-12 + 2 * BARRIER * at_bound).all()
    is_held = posture_uncertainty(trial.model, trial.observed, trial.tasks, found, 1e-3).is_held
    away = np.where(is_held, np.abs(found.coordinates - theirs), 0.0).max(axis=1)
    assert away[at_bound == 0].max(initial=0.0) < 2e-5
    assert away.max() < 1e-3


@dataclass(frozen=True)
class Trial:
    """A model, its markers over time, and a set-up."""

    model: Path
    markers: Path
    setup: Path


TRIALS = {
    **{
        name: Trial(NO_WEIGHT, MARKERS / f"{name}.trc", MARKERS / "ik_setup.xml")
        for name in ("FLX01", "ABD02", "SHRUG01")
    },
    **{
        f"S8R {lift}{kind and f', {kind}'}": Trial(
            SUBJECT / f"{kind or f'S8R_{lift}_as_solved'}.osim",
            SUBJECT / f"S8R_{lift}.trc",
            SUBJECT / f"S8R_{lift}_ik_setup.xml",
        )
        for kind in ("", "generic", "scaled")
        for lift in ("side", "back")
    },
}


@dataclass(frozen=True, eq=False)
class Tracked:
    """A trial as our solver takes it; time (frames,) [s], observed (frames, markers, 3) [m]."""

    model: Model
    time: Array
    tasks: TrackingTasks
    observed: Array

    def solve(self) -> InverseKinematics:
        return solve_inverse_kinematics(self.model, self.observed, self.tasks)


def tracked(trial: Trial, end: float = np.inf) -> Tracked:
    model, setup = read_osim(trial.model), read_ik_setup(trial.setup)
    table = read_trc(trial.markers, tracked=setup.markers)
    kept = table.time_s <= end + 1e-6
    tasks = setup.tasks(model, table.labels, table.time_s[kept])
    columns = [table.labels.index(marker.name) for marker in tasks.markers]
    return Tracked(model, table.time_s[kept], tasks, 1e-3 * table.positions[kept][:, columns])


def count_bounds(model: Model, coordinates: Array) -> NDArray[np.int64]:
    """(frames,) number of clamped coordinates at an end of their range; OpenSim's interior point stays off it."""
    ranges = np.array([each.range if each.is_clamped else (-np.inf, np.inf) for each in model.coordinates])
    return np.asarray((np.abs(coordinates[..., None] - ranges) < 1e-12).sum(axis=(1, 2)))


def solved_by_opensim(trial: Trial, model: Model, folder: Path, accuracy: float, end: float = 1e3) -> Array:
    """q (frames, coordinates) [rad or m] of OpenSim's InverseKinematicsTool."""
    settings = {"setModel": opensim.Model(str(trial.model)), "setMarkerDataFileName": str(trial.markers)}
    settings |= {"setStartTime": 0.0, "setEndTime": end, "set_accuracy": accuracy, "set_report_errors": False}
    settings |= {"setOutputMotionFileName": str(folder / "theirs.mot"), "setResultsDir": str(folder)}
    tool = opensim.InverseKinematicsTool(str(trial.setup))
    for setter, value in settings.items():
        getattr(tool, setter)(value)
    assert tool.run()
    columns, table, _ = read_table(folder / "theirs.mot")
    scale = [np.pi / 180 if coordinate.motion == "rotation" else 1.0 for coordinate in model.coordinates]
    coordinates: Array = table[:, [columns.index(name) for name in model.coordinate_names]] * scale
    return coordinates


def varied(seed: int, folder: Path) -> Trial:
    """A dozen frames of a public trial with one to three variations; files go to the folder."""
    chance = np.random.default_rng(seed)
    trial = TRIALS[list(TRIALS)[seed % len(TRIALS)]]
    setup = read_ik_setup(trial.setup)
    table = _excerpt(read_trc(trial.markers, tracked=setup.markers), chance)
    document = ElementTree.fromstring(trial.model.read_bytes())  # noqa: S314  (a file of the public data)
    draft = _Draft(read_osim(trial.model), setup, table, document)
    for vary in chance.permutation(VARIATIONS)[: chance.integers(1, 4)]:
        draft = vary(draft, chance)
    made = Trial(folder / "model.osim", folder / "trial.trc", folder / "setup.xml")
    made.model.write_bytes(ElementTree.tostring(draft.document))
    made.markers.write_text(write_trc(draft.table, "trial.trc"), encoding="utf-8")
    ElementTree.ElementTree(ik_setup_document(draft.setup, folder)).write(made.setup)
    return made


@dataclass(frozen=True, eq=False)
class _Draft:
    model: Model
    setup: IkSetup
    table: MarkerTable
    document: ElementTree.Element

    def posture(self) -> Array:
        """Median of the postures that the unvaried tasks give."""
        tasks = self.setup.tasks(self.model, self.table.labels, self.table.time_s)
        columns = [self.table.labels.index(marker.name) for marker in tasks.markers]
        found = solve_inverse_kinematics(self.model, 1e-3 * self.table.positions[:, columns], tasks).coordinates
        return np.asarray(np.nanmedian(found, axis=0))

    def set(self, coordinate: str, **values: str) -> None:
        element = next(each for each in self.document.iter("Coordinate") if each.get("name") == coordinate)
        for tag, value in values.items():
            found = element.find(tag)
            found = ElementTree.SubElement(element, tag) if found is None else found
            found.text = value


def _excerpt(table: MarkerTable, chance: np.random.Generator) -> MarkerTable:
    every = int(chance.choice([1, 1, 2, 5]))
    first = int(chance.integers(0, len(table.time_s) - FRAMES * every))
    positions = table.positions[first : first + FRAMES * every : every].copy()
    rate = table.rate_hz / every
    return MarkerTable(table.labels, rate, np.arange(FRAMES) / rate, positions, np.zeros(positions.shape[:2]))


def _hide(draft: _Draft, chance: np.random.Generator) -> _Draft:
    """Single markers in single frames, or some markers for a third of the frames, or throughout."""
    positions = draft.table.positions.copy()
    known = [name for name in draft.setup.markers if name in draft.table.labels]
    columns = [draft.table.labels.index(name) for name in chance.permutation(known)]
    match chance.integers(0, 3):
        case 0:
            positions[chance.random(positions.shape[:2]) < 0.1] = np.nan
        case 1:
            positions[:, columns[: chance.integers(1, 3)]] = np.nan
        case _:
            positions[4:8, columns[: chance.integers(1, 5)]] = np.nan
    return replace(draft, table=replace(draft.table, positions=positions))


def _lock(draft: _Draft, chance: np.random.Generator) -> _Draft:
    posture = draft.posture()
    for k in chance.choice(np.arange(6, len(posture)), chance.integers(1, 4), replace=False):
        value = float(posture[k] + 0.15 * chance.standard_normal())
        limits = f"{min(value - 1, -3)} {max(value + 1, 3)}"
        draft.set(draft.model.coordinate_names[k], default_value=repr(value), locked="true", range=limits)
    return draft


def _clamp(draft: _Draft, chance: np.random.Generator) -> _Draft:
    """A range that ends near the posture, on either side."""
    posture = draft.posture()
    for k in chance.choice(len(posture), chance.integers(1, 5), replace=False):
        bound = float(posture[k]) + 0.03 * chance.standard_normal()
        low, high = (bound - 0.6, bound) if chance.random() < 0.5 else (bound, bound + 0.6)
        default = float(np.clip(draft.model.default_coordinates[k], low, high))
        name = draft.model.coordinate_names[k]
        draft.set(name, clamped="true", range=f"{low} {high}", default_value=repr(default))
    return draft


def _pull(draft: _Draft, chance: np.random.Generator) -> _Draft:
    posture, tasks = draft.posture(), dict(draft.setup.coordinates)
    for k in chance.choice(len(posture), chance.integers(1, 4), replace=False):
        weight, target = 10 ** chance.uniform(-6, -1), posture[k] + 0.2 * chance.standard_normal()
        is_default = bool(chance.random() < 0.5)
        tasks[draft.model.coordinate_names[k]] = CoordinateTask(weight, None if is_default else target, is_default)
    return replace(draft, setup=replace(draft.setup, coordinates=tasks))


VARIATIONS: list[Callable[[_Draft, np.random.Generator], _Draft]] = [_hide, _lock, _clamp, _pull]
