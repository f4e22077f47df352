"""The muscle effort, (10) of the source study: exponent, weights, and a user's own convex cost, in one place.

    Σ w φ(a) + Σ w r²,   φ(a) = aᵖ with p = 2 or 3, or an ActivationCost

a are the activations of the muscles, r the controls of the actuators, which keep squares. The compiled solver has the
powers (`slope` and the functions after it, with q = p w); another cost is minimised by quadratic programs of its slope
and curvature (conic.py).

Options of the muscle-redundancy problem: weights, constraints, exponent of the effort, and solver.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from math import sqrt
from typing import Annotated, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from solver.checks import ensure_known, ensure_names, ensure_type
from solver.errors import SolverCode
from solver.model import Array, CoordinateActuator, Model, ModelError
from solver.multibody.constraints import is_held
from solver.multibody.dynamics import ReactionRequest
from solver.muscle import MuscleForceModel, PathMode
from solver.redundancy.mechanics import JOINT, is_shoulder

Exponent = Literal[2, 3]
Number = TypeVar("Number", float, Array)
SAMPLES = 21  # activations from 0 to 1 at which a cost is checked
DERIVATIVE_TOLERANCE = 0.1  # of the largest change between samples, for the integral of the derivative
PROXIMAL_SHARE = 0.01  # of the greatest slope: where a cost is straighter, steps are those of a proximal method
ROUND_OFF = 1e-9  # of the greatest slope of all activations


@dataclass(frozen=True)
class ActivationCost:
    """A convex cost φ of an activation in place of its power, as cost of RedundancyOptions.

        ActivationCost(lambda a: a**4, lambda a: 4 * a**3, lambda a: 12 * a**2)

    value, slope and curvature are functions of activations (…, muscles) from 0 to 1, entry by entry, with results of
    the same shape: φ, φ' and φ'' ≥ 0. Muscles may differ: `p * a ** (p - 1)` with p (muscles,) in the model's order.
    The weights of the options multiply φ. Where φ'' is zero, the activations of least effort may not be unique.
    """

    value: Callable[[Array], Array]
    slope: Callable[[Array], Array]
    curvature: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class Effort:
    """Terms of the effort of x (…, controls), muscles first, or of the muscles alone; their slopes and curvatures.

    weights (controls,);  muscles, the number of controls with φ;  exponent p, without a meaning where there is a cost
    """

    weights: Array
    muscles: int
    exponent: int = 2
    cost: ActivationCost | None = None

    @property
    def has_quadratic_steps(self) -> bool:
        """Whether a quadratic program takes its slope and curvature; the compiled solver has cubes of its own."""
        return self.exponent == 2 or self.cost is not None

    def terms(self, x: Array) -> Array:
        """w φ(a), then w r² of the actuators: the terms of (10)."""
        terms: Array = self.weights[: x.shape[-1]] * x**2
        if self.cost is not None:
            terms[..., : self.muscles] = self.weights[: self.muscles] * self.cost.value(x[..., : self.muscles])
        elif self.exponent == 3:
            terms[..., : self.muscles] *= x[..., : self.muscles]
        return terms

    def slopes(self, activations: Array) -> Array:
        """Derivatives of the terms of the muscles by their activations (…, muscles)."""
        weights = self.weights[: self.muscles]
        if self.cost is not None:
            return weights * self.cost.slope(activations)
        return slope(self.exponent * weights, activations, self.exponent)

    def gradient(self, x: Array) -> Array:
        """Derivatives of the terms by x (…, controls)."""
        muscles = x[..., : self.muscles]
        return np.concatenate(
            [self.slopes(muscles), 2 * self.weights[self.muscles :] * x[..., self.muscles :]], axis=-1
        )

    def curvatures(self, activations: Array) -> Array:
        """Second derivatives of the terms of the muscles by their activations (…, muscles); positive with a cost."""
        weights = self.weights[: self.muscles]
        if self.cost is not None:
            ends = np.repeat([[0.0], [1.0]], self.muscles, axis=1)  # at one of them a convex function is steepest
            here, anywhere = np.abs(self.slopes(activations)).max(), np.abs(self.slopes(ends)).max()
            least = max(PROXIMAL_SHARE * here, ROUND_OFF * anywhere)
            curvatures: Array = np.maximum(weights * self.cost.curvature(activations), least)
            return curvatures
        return curvature(self.exponent * weights, activations, self.exponent)


@lru_cache(maxsize=8)  # a stream builds a problem in every frame
def ensure_convex(cost: ActivationCost, muscles: int) -> None:
    """Raise ModelError for a cost with values that are not finite or of another shape, a negative curvature, or a slope
    that is not the derivative of the value.
    """
    a = np.repeat(np.linspace(0.0, 1.0, SAMPLES)[:, None], muscles, axis=1)
    found = {name: np.asarray(getattr(cost, name)(a.copy())) for name in ("value", "slope", "curvature")}
    for name, values in found.items():
        if values.shape != a.shape or not np.isfinite(values).all():
            raise _wrong_cost(
                f"{name} should return finite numbers of shape {a.shape}, as that of the activations, and returned "
                f"{np.count_nonzero(np.isfinite(values))} finite numbers of shape {values.shape}"
            )
    if (found["curvature"] < 0).any():
        raise _wrong_cost(f"curvature should be at least 0 and is {found['curvature'].min():g}")
    for name, lower in (("slope", "value"), ("curvature", "slope")):
        change, expected = np.diff(found[lower], axis=0), _integrals(getattr(cost, name), a)
        missed = np.abs(change - expected).max()
        if missed > DERIVATIVE_TOLERANCE * np.abs(expected).max():
            raise _wrong_cost(
                f"{name} should be the derivative of {lower}, and its integral differs from the change of {lower} by "
                f"{missed:.2g}"
            )


def _integrals(function: Callable[[Array], Array], a: Array) -> Array:
    """Integrals over the intervals between the rows of a, by Gauss and Legendre's rule with three points."""
    points, weights = np.polynomial.legendre.leggauss(3)
    half = 0.5 * np.diff(a, axis=0)
    rule = zip(points, weights, strict=True)
    inside = [half * weight * function(a[:-1] + half * (1.0 + point)) for point, weight in rule]
    return np.asarray(np.sum(inside, axis=0))


def _wrong_cost(found: str) -> ModelError:
    return ModelError(
        f"a cost of activations should be convex and smooth: {found}; correct it", SolverCode.WRONG_OPTION
    )


def slope(q: Number, a: Number, exponent: int) -> Number:
    """q aᵖ⁻¹."""
    return q * a if exponent == 2 else q * a * a


def curvature(q: Number, a: Number, exponent: int) -> Number:
    """(p − 1) q aᵖ⁻²; with p = 3 it vanishes at rest."""
    return q if exponent == 2 else 2.0 * q * a


def activation(q: float, gain: float, exponent: int) -> float:
    """The activation with this slope; with p = 3 there is none below zero, and a muscle rests."""
    return gain / q if exponent == 2 else sqrt(max(gain, 0.0) / q)


def activation_per_slope(q: float, a: float, exponent: int) -> float:
    """Derivative of the activation by its slope, 1 / curvature; 0 for a muscle that rests at p = 3."""
    if exponent == 2:
        return 1.0 / q
    return 0.0 if a == 0.0 else 1.0 / (2.0 * q * a)


Solver = Literal["interior_point", "clarabel"]
Tendons = Literal["rigid", "elastic"]
_KNOWN = {
    "path_mode": get_args(PathMode),
    "exponent": get_args(Exponent),
    "solver": get_args(Solver),
    "muscle_force_model": get_args(MuscleForceModel),
    "tendons": get_args(Tendons),
}

UNWEIGHTED_COORDINATES = (
    *(f"ground_thorax_{axis}" for axis in ("rot_x", "rot_y", "rot_z", "tx", "ty", "tz")),
    "elbow_flexion",
    "pro_sup",
)

LEAST_RANGE = 1e-6  # of an activation: the interior point needs an interior


@dataclass(frozen=True)
class RedundancyOptions:
    """Weights and constraints of the problem; the defaults are the published ones.

    has_glenoid_cone        keep the reaction inside the glenoid
    free_coordinates        accelerations that need not be tracked (published for shrugs: plane_elv, axial_rot)
    muscle_weight           w of each muscle
    reserve_weight          w of the reserve actuators
    unweighted_coordinates  whose actuators have no weight: those that carry the thorax and the forearm
    weights                 w in place of the above, by the name of a muscle, of a coordinate for its actuator, or of an
                            actuator on bodies
    glenoid_aspect          width of an elliptic glenoid across the direction of its edge marker, over that along it
    joint                   the glenoid cone's joint, whose reaction every solution has
    reactions               further joints whose reactions are computed, and how they are given
    exponent                p of the activations, 2 or 3 (Crowninshield & Brand 1981, J. Biomech. 14:793); reserves keep
                            squares
    path_mode               wrapping as in OpenSim or over geodesics (docs/paths.md)
    solver                  interior_point, compiled for this problem, or clarabel, its reference
    has_activation_dynamics  bounds of the activations follow from those of the previous frame
    muscle_force_model      rigid_tendon, or without passive forces: active, opensim_static (solver/muscle.py)
    has_muscle_limits       activations stay within Muscle.min_control and max_control, else within 0 and 1
    tendons                 rigid, or elastic where the model's file has them so (docs/tendons.md)
    cost                    a convex function of the activations in place of their power (effort.py), with exponent 2
                            and the solver interior_point
    """

    has_glenoid_cone: bool = True
    free_coordinates: tuple[str, ...] = ()
    muscle_weight: float = 1.0
    reserve_weight: float = 10.0
    unweighted_coordinates: tuple[str, ...] = UNWEIGHTED_COORDINATES
    weights: Mapping[str, float] = field(default_factory=dict)
    glenoid_aspect: float = 1.0
    joint: str = JOINT
    reactions: ReactionRequest = field(default_factory=ReactionRequest)
    path_mode: PathMode = "opensim"
    exponent: Exponent = 2
    solver: Solver = "interior_point"
    has_activation_dynamics: bool = True
    muscle_force_model: MuscleForceModel = "rigid_tendon"
    has_muscle_limits: bool = False
    tendons: Tendons = "rigid"
    cost: ActivationCost | None = None

    def __post_init__(self) -> None:
        """Raise ModelError for a value that is not known: most would act as the default does."""
        for name, known in _KNOWN.items():
            ensure_known(name, getattr(self, name), known)
        for name in ("free_coordinates", "unweighted_coordinates"):
            ensure_names(name, getattr(self, name))
        if self.cost is not None:
            ensure_type("cost", self.cost, ActivationCost, "an ActivationCost of value, slope and curvature")
        if self.cost is not None and (self.exponent != 2 or self.solver == "clarabel"):
            raise ModelError(
                f"a cost of activations stands in place of an exponent and has a solver of its own, and exponent is "
                f"{self.exponent}, solver {self.solver}; leave out cost or both",
                SolverCode.WRONG_OPTION,
            )
        if not 0.0 < self.glenoid_aspect < np.inf:
            raise ModelError(
                f"glenoid_aspect should be a ratio above 0 and is {self.glenoid_aspect}; give another",
                SolverCode.WRONG_OPTION,
            )


def static_optimisation(options: RedundancyOptions) -> RedundancyOptions:
    """The options with the assumptions of OpenSim's StaticOptimization: every frame by itself, without activation
    dynamics, passive muscle forces and the glenoid, with the limits of the muscles and a weight of 1 for all controls.
    """
    return replace(
        options,
        has_glenoid_cone=False,
        muscle_weight=1.0,
        reserve_weight=1.0,
        unweighted_coordinates=(),
        has_activation_dynamics=False,
        muscle_force_model="opensim_static",
        has_muscle_limits=True,
    )


def activation_limits(model: Model) -> Array:
    """(2, muscles) least and greatest activation in the model's file, of a paralysed muscle nearly the same."""
    limits = [
        [muscle.min_control, max(muscle.max_control, muscle.min_control + LEAST_RANGE)] for muscle in model.muscles
    ]
    return np.array(limits).reshape(-1, 2).T


def options_for(model: Model, options: RedundancyOptions) -> RedundancyOptions:
    """The options for a model that may have no shoulder: without the joint GlenoHumeral and the markers of a glenoid
    there is no cone, and the reaction is that of the model's last joint.
    """
    if options.joint != JOINT or is_shoulder(model):
        return options
    return replace(options, has_glenoid_cone=False, joint=model.joints[-1].name)


def tracked_coordinates(model: Model, options: RedundancyOptions) -> NDArray[np.bool_]:
    """(coordinates,) neither free nor determined by a lock or a coupler. ModelError for an unknown free coordinate."""
    tracked = ~is_held(model)
    tracked[[model.coordinate_index(name) for name in options.free_coordinates]] = False
    return tracked


def effort_weights(model: Model, options: RedundancyOptions) -> Array:
    """w (controls,), actuators after muscles. ModelError for a weight without a muscle or actuator, or below zero."""
    driven = model.actuated_names
    reserves = [0.0 if name in options.unweighted_coordinates else options.reserve_weight for name in driven]
    names = [*model.muscle_names, *driven]
    unknown = sorted(set(options.weights) - set(names))
    if unknown:
        raise ModelError(
            f"the weight of {', '.join(unknown)} should be that of a muscle, of a coordinate with an actuator, or of "
            f"an actuator on bodies of {model.name}, and is not; use a name of the model",
            SolverCode.UNKNOWN_NAME,
        )
    usual = [options.muscle_weight] * len(model.muscles) + reserves
    weights = np.array([options.weights.get(name, weight) for name, weight in zip(names, usual, strict=True)])
    if not (weights >= 0.0).all():
        raise ModelError(
            f"weights should be numbers from 0 and one is {weights.min():g}; an effort is a sum of powers",
            SolverCode.NEGATIVE_WEIGHT,
        )
    return weights


@dataclass(frozen=True)
class Reserve:
    """An actuator that gives optimal_force [N or N m] at x = 1, and keeps x within its limits."""

    optimal_force: Annotated[float, Field(gt=0, allow_inf_nan=False)]
    min_control: Annotated[float, Field(le=0)] = -np.inf
    max_control: Annotated[float, Field(ge=0)] = np.inf

    def __post_init__(self) -> None:
        """Raise ModelError for values that effort.toml refuses, too."""
        if not (0.0 < self.optimal_force < np.inf and self.min_control <= 0.0 <= self.max_control):
            raise ModelError(
                f"a reserve should have a finite optimal_force above 0 and control limits around 0, and has "
                f"{self.optimal_force} and {self.min_control} to {self.max_control}; give others",
                SolverCode.WRONG_OPTION,
            )


def with_reserves(model: Model, reserves: Mapping[str, Reserve]) -> Model:
    """The model with such an actuator on each of these coordinates, by name: reserves [N m], residuals [N].

    It replaces the actuator of the coordinate if there is one. Raises ModelError where there is no such coordinate, and
    TypeError for arguments of another type.
    """
    ensure_type("model", model, Model, "a Model, as load_model(…) returns")
    ensure_type("reserves", reserves, Mapping, "a mapping from names of coordinates to Reserve")
    for reserve in reserves.values():
        ensure_type("reserves", reserve, Reserve, "a mapping from names of coordinates to Reserve")
    named = {model.coordinate_index(name): reserve for name, reserve in reserves.items()}
    kept = tuple(
        actuator
        for actuator in model.actuators
        if not (isinstance(actuator, CoordinateActuator) and actuator.coordinate in named)
    )
    added = tuple(
        CoordinateActuator(model.coordinate_names[coordinate] + "_reserve", coordinate, **vars(reserve))
        for coordinate, reserve in named.items()
    )
    return replace(model, actuators=kept + added)
