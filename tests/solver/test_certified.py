"""The solver's numbers are OpenSim's: the same claims on stored values and, where there is an OpenSim, on fresh ones.

certified    20 states of the bundled model, in certified.json
golden       24 states of the published model, beside the repository
random       20 states of the bundled model, built and evaluated in OpenSim here and now; 60 with the slow tests
motions      some frames of every published motion beside the repository, the model read from its file by OpenSim, and
             golden's states again, for the multipliers that golden.npz does not hold; more with the slow tests
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path

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
    state = postures(model, expected["q"], expected["u"])
    equations, paths = equations_of_motion(model, state), evaluate_paths(model, state)
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    return Comparison(
        expected, model, state, equations, paths, forces, maps=response_maps(model, state, equations, paths, forces)
    )


def test_poses_and_velocities_of_bodies(compared: Comparison) -> None:
    state, expected = compared.state, compared.expected
    velocity = np.concatenate([state.angular_velocity, state.origin_velocity], axis=-1)
    assert greatest_difference(state.rotation_to_ground[:, 1:], expected["rotation"]) < 1e-13
    assert greatest_difference(state.origin_in_ground[:, 1:], expected["origin"]) < 1e-13
    assert relative_difference(velocity[:, 1:], expected["velocity"]) < 1e-13


def test_mass_matrix_and_constraint(compared: Comparison) -> None:
    equations, expected = compared.equations, compared.expected
    assert relative_difference(equations.mass_matrix, expected["mass_matrix"]) < 1e-12
    jacobian, bias = constraint_rows(compared.model, compared.state)
    assert relative_difference(jacobian, expected["constraint_jacobian"]) < 1e-12
    assert relative_difference(bias, expected["constraint_bias"]) < 1e-12


def test_path_lengths_and_speeds(compared: Comparison) -> None:
    assert greatest_difference(compared.paths.lengths, compared.expected["length"]) < 1e-12
    assert greatest_difference(compared.paths.speeds, compared.expected["speed"]) < 1e-11


def test_generalised_forces_of_a_unit_tension(compared: Comparison) -> None:
    assert greatest_difference(compared.force_per_tension(), compared.expected["force_per_tension"]) < 1e-11


def test_forces_of_muscles(compared: Comparison) -> None:
    """In motion and at rest, where the velocity factor is 1: so the factors of length and velocity hold alone, too."""
    forces, lengths = compared.forces, compared.paths.lengths
    at_length, at_speed, passive, cosine = np.moveaxis(compared.expected["factors"], -1, 0)
    strength = np.array([muscle.max_isometric_force for muscle in compared.model.muscles])
    at_rest = muscle_forces(compared.model, lengths, np.zeros_like(lengths))
    assert greatest_difference(forces.cos_pennation, cosine) < 1e-12
    assert greatest_difference(at_rest.active / strength, at_length * cosine) < 1e-12
    assert greatest_difference(forces.active / strength, at_length * at_speed * cosine) < 1e-12
    assert greatest_difference(forces.passive / strength, passive * cosine) < 1e-12


@pytest.mark.parametrize(
    "name", ["acceleration_at_rest", "acceleration_per_control", "reaction_at_rest", "reaction_per_control"]
)
def test_maps_of_the_redundancy_problem(compared: Comparison, name: str) -> None:
    assert relative_difference(getattr(compared.maps, name), compared.expected[name]) < 1e-10


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
    pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    from tests.solver.certify import Oracle

    model = read_osim(NO_WEIGHT)
    kinematics = decimate(differentiate(read_motion(file, model)), every)
    q, u = kinematics.positions, kinematics.speeds
    state = postures(model, q, u)
    paths, equations = evaluate_paths(model, state), equations_of_motion(model, state)
    forces = muscle_forces(model, paths.lengths, paths.speeds)
    maps = response_maps(model, state, equations, paths, forces)
    at_rest = Oracle(model, NO_WEIGHT).evaluate_at_rest(q, u, forces.passive)
    assert greatest_difference(paths.lengths, at_rest["length"]) < 1e-12
    assert greatest_difference(paths.speeds, at_rest["speed"]) < 1e-11
    assert relative_difference(maps.acceleration_at_rest, at_rest["acceleration_at_rest"]) < 1e-10
    assert relative_difference(maps.reaction_at_rest, at_rest["reaction_at_rest"]) < 1e-10


def _certified() -> tuple[Model, dict[str, Array]]:
    return bundled_model(), certified()


def _golden() -> tuple[Model, dict[str, Array]]:
    return read_osim(NO_WEIGHT), golden()


def _random(states: int) -> tuple[Model, dict[str, Array]]:
    pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    from tests.solver.certify import Oracle

    model, random = bundled_model(), np.random.default_rng(200)
    q = model.default_coordinates + 0.2 * random.normal(size=(states, len(model.coordinates)))
    # An arm that hangs down is where the shoulder's three angles are singular, and no two programs agree to 1e-12.
    q[:, model.coordinate_index("shoulder_elv")] = random.uniform(0.3, 2.3, states)
    return model, Oracle(model).evaluate_all(q, random.normal(size=q.shape))


def _motions(every: int) -> tuple[Model, dict[str, Array]]:
    pytest.importorskip("opensim", reason="needs OpenSim: install the extra oracle")
    from tests.solver.certify import Oracle

    model = read_osim(NO_WEIGHT)
    moves = [differentiate(read_motion(file, model)) for file in sorted((SHARED / "motions").glob("*.mot"))]
    q, u = (
        np.concatenate([*(getattr(move, name)[::every] for move in moves), golden()[letter][:: every // 80]])
        for name, letter in (("positions", "q"), ("speeds", "u"))
    )
    return model, Oracle(model, NO_WEIGHT).evaluate_all(q, u)


_REFERENCES = {
    "certified": _certified,
    "golden": _golden,
    "random": partial(_random, 20),
    "motions": partial(_motions, 240),
    "more random": partial(_random, 60),
    "more motions": partial(_motions, 80),
}
