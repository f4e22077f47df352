"""The solver's numbers are OpenSim's: the same claims on stored values and, where there is an OpenSim, on fresh ones.

certified    20 states of the bundled model, in certified.json
golden       24 states of the published model, beside the repository
random       20 states of the bundled model, built and evaluated in OpenSim here and now; 60 with the slow tests
motions      some frames of every published motion beside the repository, the model read from its file by OpenSim, and
             golden's states again, for the multipliers that golden.npz does not hold; more with the slow tests
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.model import Array, Model
from solver.motion import decimate, differentiate, read_motion
from solver.multibody.constraints import constraint_gaps, constraint_rows
from solver.multibody.dynamics import EquationsOfMotion, equations_of_motion, multipliers
from solver.multibody.postures import Postures, jacobians, postures, speeds_from_rates
from solver.muscle import MuscleForces, PathState, evaluate_paths, muscle_forces
from solver.osim.model_reader import read_osim
from solver.redundancy.mechanics import ResponseMaps, response_maps
from tests.solver.references import NO_WEIGHT, SHARED, certified, golden, greatest_difference, relative_difference

_ORACLE, _SHARED = pytest.mark.oracle, pytest.mark.shared


@dataclass(frozen=True)
class Comparison:
    """OpenSim's values and everything the solver computes at the same states."""

    expected: dict[str, Array]
    model: Model
    state: Postures
    equations: EquationsOfMotion
    paths: PathState
    forces: MuscleForces
    maps: ResponseMaps

    @property
    def strength(self) -> Array:
        return np.array([muscle.max_isometric_force for muscle in self.model.muscles])

    def force_per_tension(self) -> Array:
        wrench, columns = self.paths.wrench_per_tension, jacobians(self.model, self.state)
        return np.einsum("fmbi,fbij->fmj", wrench, columns) + self.paths.mobility_per_tension


@pytest.fixture(
    scope="module",
    params=[
        "certified",
        pytest.param("golden", marks=_SHARED),
        pytest.param("random", marks=_ORACLE),
        pytest.param("motions", marks=[_SHARED, _ORACLE]),
        pytest.param("more random", marks=[_ORACLE, pytest.mark.slow]),
        pytest.param("more motions", marks=[_SHARED, _ORACLE, pytest.mark.slow]),
    ],
)
def compared(request: pytest.FixtureRequest) -> Comparison:
    model, expected = _REFERENCES[request.param]()
    length, speed, passive, cosine = np.moveaxis(expected["factors"], -1, 0)
    forces = {"cosine": cosine, "active_at_rest": length * cosine, "active": length * speed * cosine}
    return compare(model, expected | forces | {"passive": passive * cosine})


def compare(model: Model, expected: dict[str, Array]) -> Comparison:
    state = postures(model, expected["q"], expected["u"])
    equations, paths = equations_of_motion(model, state), evaluate_paths(model, state)
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    maps = response_maps(model, state, equations, paths, forces)
    return Comparison(expected, model, state, equations, paths, forces, maps)


def velocities(c: Comparison) -> Array:
    return np.concatenate([c.state.angular_velocity, c.state.origin_velocity], axis=-1)[:, 1:]


def at_rest(c: Comparison) -> Array:
    """The velocity factor is 1: so the factors of length and velocity hold alone, too."""
    return muscle_forces(c.model, c.paths.lengths, np.zeros_like(c.paths.lengths)).active


FOUND: dict[str, tuple[Callable[[Comparison], Array], Callable[[Array, Array], float], float]] = {
    "rotation": (lambda c: c.state.rotation_to_ground[:, 1:], greatest_difference, 1e-13),
    "origin": (lambda c: c.state.origin_in_ground[:, 1:], greatest_difference, 1e-13),
    "velocity": (velocities, relative_difference, 1e-13),
    "mass_matrix": (lambda c: c.equations.mass_matrix, relative_difference, 1e-12),
    "constraint_jacobian": (lambda c: constraint_rows(c.model, c.state)[0], relative_difference, 1e-12),
    "constraint_bias": (lambda c: constraint_rows(c.model, c.state)[1], relative_difference, 1e-12),
    "length": (lambda c: c.paths.lengths, greatest_difference, 1e-12),
    "speed": (lambda c: c.paths.speeds, greatest_difference, 1e-11),
    "force_per_tension": (Comparison.force_per_tension, greatest_difference, 1e-11),
    "cosine": (lambda c: c.forces.cos_pennation, greatest_difference, 1e-12),
    "active_at_rest": (lambda c: at_rest(c) / c.strength, greatest_difference, 1e-12),
    "active": (lambda c: c.forces.active / c.strength, greatest_difference, 1e-12),
    "passive": (lambda c: c.forces.passive / c.strength, greatest_difference, 1e-12),
    "acceleration_at_rest": (lambda c: c.maps.acceleration_at_rest, relative_difference, 1e-10),
    "acceleration_per_control": (lambda c: c.maps.acceleration_per_control, relative_difference, 1e-10),
    "reaction_at_rest": (lambda c: c.maps.reaction_at_rest, relative_difference, 1e-10),
    "reaction_per_control": (lambda c: c.maps.reaction_per_control, relative_difference, 1e-10),
}


@pytest.mark.parametrize("name", FOUND)
def test_a_quantity_is_that_of_opensim(compared: Comparison, name: str) -> None:
    found, difference, tolerance = FOUND[name]
    assert difference(found(compared), compared.expected[name]) < tolerance


def test_constraint_forces(compared: Comparison) -> None:
    expected = compared.expected
    if "multipliers_at_rest" not in expected:
        pytest.skip("golden.npz holds no multipliers; among `motions` are those of its states")
    force = np.einsum("fm,fmj->fj", expected["passive_force"], expected["force_per_tension"])
    assert relative_difference(multipliers(compared.equations, force), expected["multipliers_at_rest"]) < 1e-12


@pytest.mark.shared
def test_gap_of_the_constraint_and_speeds_of_the_scapula() -> None:
    model, expected = read_osim(NO_WEIGHT), golden()
    state = postures(model, expected["q"], expected["u"])
    assert greatest_difference(constraint_gaps(model, state), expected["constraint_gap"]) < 1e-15
    rate = np.einsum("fij,fj->fi", constraint_rows(model, state)[0], expected["u"])
    assert relative_difference(rate, expected["constraint_rate"]) < 1e-12
    assert greatest_difference(speeds_from_rates(model, expected["q"], expected["rates"]), expected["u"]) < 1e-14


@pytest.mark.shared
@pytest.mark.oracle
@pytest.mark.parametrize("every", [12, pytest.param(1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("file", sorted((SHARED / "motions").glob("*.mot")), ids=lambda file: file.stem)
def test_frames_of_every_published_motion(file: Path, every: int) -> None:
    model = read_osim(NO_WEIGHT)
    kinematics = decimate(differentiate(read_motion(file, model)), every)
    found = compare(model, {"q": kinematics.positions, "u": kinematics.speeds})
    expected = _oracle(model, NO_WEIGHT).evaluate_at_rest(kinematics.positions, kinematics.speeds, found.forces.passive)
    for name, values in expected.items():
        value, difference, tolerance = FOUND[name]
        assert difference(value(found), values) < tolerance, name


def _oracle(*arguments: Any) -> Any:
    pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    from tests.solver.certify import Oracle

    return Oracle(*arguments)


def _random(states: int) -> tuple[Model, dict[str, Array]]:
    model, random = bundled_model(), np.random.default_rng(200)
    q = model.default_coordinates + 0.2 * random.normal(size=(states, len(model.coordinates)))
    # An arm that hangs down is where the shoulder's three angles are singular, and no two programs agree to 1e-12.
    q[:, model.coordinate_index("shoulder_elv")] = random.uniform(0.3, 2.3, states)
    return model, _oracle(model).evaluate_all(q, random.normal(size=q.shape))


def _motions(every: int) -> tuple[Model, dict[str, Array]]:
    model = read_osim(NO_WEIGHT)
    moves = [differentiate(read_motion(file, model)) for file in sorted((SHARED / "motions").glob("*.mot"))]
    q, u = (
        np.concatenate([*(getattr(move, name)[::every] for move in moves), golden()[letter][:: every // 80]])
        for name, letter in (("positions", "q"), ("speeds", "u"))
    )
    return model, _oracle(model, NO_WEIGHT).evaluate_all(q, u)


_REFERENCES = {
    "certified": lambda: (bundled_model(), certified()),
    "golden": lambda: (read_osim(NO_WEIGHT), golden()),
    "random": partial(_random, 20),
    "motions": partial(_motions, 240),
    "more random": partial(_random, 60),
    "more motions": partial(_motions, 80),
}
