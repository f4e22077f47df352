"""The published trials beside the repository: what was published and what we find.

    python -m tests.solver.published

prints how far they are apart, trial by trial.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from solver.cuff import CuffParameters
from solver.model import Array, Model
from solver.motion import Kinematics, differentiate, read_motion
from solver.osim.model_reader import read_osim
from solver.redundancy.effort import RedundancyOptions
from solver.redundancy.mechanics import evaluate_motion
from solver.redundancy.problem import RedundancyProblem, build_redundancy
from solver.redundancy.sequence import ScenarioSolutions, solve_redundancy
from tests.fitting.experiment import PUBLISHED
from tests.solver.references import SHARED

FREE_IN_SHRUGS = ("plane_elv", "axial_rot")
TRIALS = [
    ("FLX01", "noWeight", ()),
    ("FLX21", "2kgWeight", ()),
    ("ABD02", "noWeight", ()),
    ("SHRUG01", "noWeight", FREE_IN_SHRUGS),
]

STUDY = {
    ("rigid", None): (0.787, 0.74, 0.79, 3.9),
    ("shift", "hand"): (0.829, 0.71, 0.79, 4.1),
    ("visco_elastic", "hand"): (0.798, 0.72, 0.79, 5.2),
    ("both", "hand"): (0.858, 0.70, 0.79, 5.3),
    ("shift", "tube"): (0.829, 0.72, 0.79, 3.9),
    ("visco_elastic", "tube"): (0.803, 0.72, 0.79, 5.4),
    ("both", "tube"): (0.854, 0.70, 0.79, 5.4),
    ("shift", "elbow"): (0.869, 0.71, 0.78, 3.7),
    ("visco_elastic", "elbow"): (0.818, 0.70, 0.79, 6.0),
    ("both", "elbow"): (0.877, 0.68, 0.79, 5.8),
}
"""Condition and arm cuff → cost at 0.74 m, best rest length [m], cost there, permissible error [cm], as published."""


def study_cuffs(relative_errors: Sequence[float] = ()) -> list[CuffParameters]:
    """The published cuffs, with these standard errors of stiffness, damping and migration over the value."""
    cuffs = []
    for name, values in PUBLISHED.items():
        errors = [(error * value) ** 2 for error, value in zip(relative_errors, values, strict=False)]
        covariance = np.diag(errors) if errors else np.zeros((0, 0))
        cuffs.append(CuffParameters(name, "waist" if name == "waist" else "arm", *values, covariance))
    return cuffs


def trial(name: str, weight: str = "noWeight") -> tuple[Model, Kinematics]:
    model = read_osim(SHARED / "models" / f"TSM_subject_{weight}.osim")
    return model, differentiate(read_motion(SHARED / "motions" / f"{name}.mot", model))


@dataclass(frozen=True)
class Published:
    """A published trial: its problem, what we find, and the activations that were published (frames, muscles)."""

    muscle_names: tuple[str, ...]
    problem: RedundancyProblem
    found: ScenarioSolutions
    activations: Array

    @property
    def ours(self) -> Array:
        return self.found.controls[0, :, : self.activations.shape[1]]

    @property
    def alone(self) -> Array:
        """x of the published activations without any actuators."""
        none = np.zeros((len(self.activations), len(self.problem.weights) - self.activations.shape[1]))
        return np.hstack([self.activations, none])

    def effort(self, controls: Array) -> Array:
        return controls**2 @ self.problem.weights


def solved_again(name: str, weight: str, free: tuple[str, ...], cone: bool) -> Published:
    """All frames: each one's bounds come from the one before."""
    model, kinematics = trial(name, weight)
    options = RedundancyOptions(has_glenoid_cone=cone, free_coordinates=free)
    problem = build_redundancy(model, evaluate_motion(model, kinematics), options)
    file = SHARED / "published" / f"{name}_{'gh' if cone else 'nogh'}.csv"
    assert file.read_text().splitlines()[0].split(",")[1:] == list(model.muscle_names)
    activations = np.loadtxt(file, delimiter=",", skiprows=1)[:, 1:]
    return Published(model.muscle_names, problem, solve_redundancy(problem), activations)


def each_frame(matrix: Array, values: Array) -> Array:
    return np.einsum("fij,fj->fi", matrix, values)


def cheapest_reserves(published: Published) -> Array:
    """x of the published activations with what they lack, in the space that A reaches, given at the least effort."""
    problem, activations = published.problem, published.activations
    muscles = activations.shape[1]
    left, sizes, right = np.linalg.svd(problem.matrix, full_matrices=False)
    rank = int((sizes > 1e-9 * sizes[:, :1]).sum(axis=1).max())
    wanted = each_frame(np.swapaxes(left[..., :rank], 1, 2), problem.target[0]) / sizes[:, :rank]
    lacking = wanted - each_frame(right[:, :rank, :muscles], activations)
    scale = np.sqrt(np.maximum(problem.weights[muscles:], 1e-9))
    inverse = np.linalg.pinv(right[:, :rank, muscles:] / scale, rcond=1e-14)
    return np.hstack([activations, each_frame(inverse, lacking) / scale])


def with_room(problem: RedundancyProblem, controls: Array) -> Array:
    """F at rest, moved along the cone's axis as far as the reaction under these controls is outside."""
    reaction = problem.reaction_at_rest[0].copy()
    if problem.cone.shape[1]:
        ray = each_frame(problem.cone, (reaction + each_frame(problem.reaction_matrix, controls))[:, 3:])
        outside = np.maximum(np.hypot(ray[:, 1], ray[:, 2]) - ray[:, 0], 0.0)
        assert outside.max() < 20.0  # of some hundreds
        axis = problem.cone[:, 0]
        reaction[:, 3:] += (outside / (axis**2).sum(axis=1))[:, None] * axis
    return reaction[None]


def main() -> None:
    print("trial    glenoid  mean |Δa|  greatest  effort of muscles / published  dearer frames")
    for name, weight, free in TRIALS:
        for cone in (True, False):
            it = solved_again(name, weight, free, cone)
            apart = np.abs(it.ours - it.activations)
            ratio = (it.ours**2).sum() / (it.activations**2).sum()
            ours, theirs = it.effort(it.found.controls[0]), it.effort(cheapest_reserves(it))
            print(
                f"{name:8} {'yes' if cone else 'no':7} {apart.mean():10.1e} {apart.max():9.3f} {ratio:30.4f} "
                f"{(ours > theirs).sum():8} of {len(ours)}"
            )


if __name__ == "__main__":
    main()
