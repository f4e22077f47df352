"""What a suit saves: the cost of a motion's muscle activations, with rigid cuffs and with the fitted ones.

Cost is the sum of w a² over muscles and frames, over that with the suit worn and its cord slack. Geometry and response
maps are computed once; a scenario (condition, cuffs, rest length) only changes the loads on the bodies.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from solver.cuff import CuffParameters
from solver.dynamics import response_to_loads
from solver.kinematics import postures
from solver.model import Model
from solver.motion import Kinematics, thin
from solver.redundancy import (
    FrameOutcome,
    LoadResponse,
    Mechanics,
    RedundancyOptions,
    RedundancyProblem,
    RedundancySolution,
    build_redundancy,
    go_through,
    solve_redundancy,
)
from solver.spatial import wrench_about_origin
from solver.suit import CordLine, Suit, SuitError, SuitForces, cord_line, suit_forces, with_suit_masses

Array = NDArray[np.float64]
Condition = Literal["rigid", "shift", "visco_elastic", "both"]

CUFF_CONDITIONS: tuple[Condition, ...] = ("shift", "visco_elastic", "both")
KEPT_REDUCTION = 0.9  # of the best one, within the permissible error of the rest length
NORMAL_95 = 1.959964


@dataclass(frozen=True)
class Figure:
    """A number with its 95 % interval, None where it has none; the value is None where no such number exists."""

    value: float | None
    ci95: tuple[float, float] | None = None


@dataclass(frozen=True)
class Optimum:
    """The best rest length [m], the normalised cost there, and the full width [m] in which 90 % of the saving is kept.

    All None where the best of the lengths tried is the first or the last; the width also where it goes beyond them.
    """

    rest_length: Figure
    normalised_cost: Figure
    permissible_error: Figure


@dataclass(frozen=True, eq=False)
class Curve:
    """One condition over the rest lengths.

    cuff          the arm cuff's name, None in the rigid condition
    cost          (rest lengths,) normalised cost of the muscles;  reserve_cost (rest lengths,) of the reserves
    at_reference  normalised cost at the suit's reference rest length
    cord_force    largest cord tension at the reference rest length [N]
    """

    condition: Condition
    cuff: str | None
    cost: Array
    reserve_cost: Array
    at_reference: Figure
    cord_force: float
    optimum: Optimum


@dataclass(frozen=True, eq=False)
class Assessment:
    """What the suit saves in one motion; costs are over that of the suit worn with a slack cord, which is 1.

    rest_lengths    (rest lengths,) tried [m];  reference_rest_length [m]
    bare_body_cost  without the suit's masses
    longest_cord    longest the cord's line becomes [m]; at a greater rest length it never pulls
    waist_cuff      name of the cuff that yields at the waist, None for a rigid one
    frames          evaluated in each of `scenarios`;  unsolved (frame, scenario) pairs that did not come out solved
    """

    rest_lengths: Array
    reference_rest_length: float
    bare_body_cost: float
    longest_cord: float
    waist_cuff: str | None
    curves: tuple[Curve, ...]
    frames: int
    scenarios: int
    unsolved: int

    def to_json(self) -> dict[str, Any]:
        """Results as {"value", "ci95"}, by arm cuff and condition, units in the keys; the curves beside them."""
        return {
            "reference_rest_length_m": self.reference_rest_length,
            "at_rigid_optimum": self._by_cuff(lambda curve: _number(curve.at_reference)),
            "optimum": self._by_cuff(
                lambda curve: {
                    "rest_length_m": _number(curve.optimum.rest_length),
                    "normalised_cost": _number(curve.optimum.normalised_cost),
                    "permissible_error_m": _number(curve.optimum.permissible_error),
                }
            ),
            "bare_body": _number(Figure(self.bare_body_cost)),
            "longest_cord_m": _number(Figure(self.longest_cord)),
            "largest_cord_force_n": self._by_cuff(lambda curve: _number(Figure(curve.cord_force))),
            "waist_cuff": self.waist_cuff,
            "rest_lengths_m": self.rest_lengths.tolist(),
            "cost": self._by_cuff(lambda curve: _finite(curve.cost)),
            "reserve_cost": self._by_cuff(lambda curve: _finite(curve.reserve_cost)),
            "frames": self.frames,
            "scenarios": self.scenarios,
            "unsolved": self.unsolved,
        }

    def _by_cuff(self, entry: Callable[[Curve], Any]) -> dict[str, Any]:
        nested: dict[str, Any] = {}
        for curve in self.curves:
            place = nested if curve.cuff is None else nested.setdefault(curve.cuff, {})
            place[curve.condition] = entry(curve)
        return nested


def assess(
    model: Model,
    kinematics: Kinematics,
    suit: Suit,
    cuffs: Iterable[CuffParameters],
    *,
    every: int = 1,
    options: RedundancyOptions | None = None,
    progress: Callable[[int, int], None] = lambda *_: None,
) -> Assessment:
    """Wear the suit in every condition: rigid, and shifted, yielding and both with each arm cuff and the waist's own.

    The cuffs follow every frame of the motion; muscles are solved in every N-th, progress(done, total) counts those.
    Raises SuitError without an arm cuff or with two at the waist, ModelError where the suit names an unknown body.
    """
    options = options or RedundancyOptions()
    arms, waist = _by_site(cuffs)
    wearings = _wearings(suit, arms, waist)
    worn = with_suit_masses(model, suit)
    bare = go_through(model, thin(kinematics, every))
    mechanics = go_through(worn, bare.kinematics, bare.paths)
    line = cord_line(suit, worn, postures(worn, kinematics.positions, kinematics.speeds), kinematics.interval)
    deviations = [_deviations(wearing, suit) for wearing in wearings]
    forces = [wearing.forces(suit, line) for wearing in chain(wearings, *deviations)]

    problem = build_redundancy(worn, mechanics, options)
    solution = solve_redundancy(problem, _loads(worn, suit, mechanics, forces, every), progress)
    without_suit = solve_redundancy(build_redundancy(model, bare, options))
    costs = _costs(problem, solution)
    slack_cost = costs[0, 0]
    outcomes = np.concatenate([solution.outcomes, without_suit.outcomes])
    return Assessment(
        rest_lengths=suit.rest_lengths,
        reference_rest_length=suit.reference_rest_length,
        bare_body_cost=float(_costs(problem, without_suit)[0, 0] / slack_cost),
        longest_cord=float(line.length.max()),
        waist_cuff=waist.name if waist else None,
        curves=_curves(suit, wearings, deviations, forces, costs[1:] / slack_cost),
        frames=outcomes.shape[1],
        scenarios=len(outcomes),
        unsolved=int((outcomes != FrameOutcome.SOLVED).sum()),
    )


@dataclass(frozen=True, eq=False)
class _Wearing:
    """The suit with these cuffs in this condition, at each of the rest lengths."""

    condition: Condition
    waist: CuffParameters | None
    arm: CuffParameters | None
    rest_lengths: Array

    def forces(self, suit: Suit, line: CordLine) -> SuitForces:
        return suit_forces(
            suit,
            line,
            self.rest_lengths,
            (self.waist, self.arm),
            is_shifted=self.condition in {"shift", "both"},
            yields=self.condition in {"visco_elastic", "both"},
        )


def _by_site(cuffs: Iterable[CuffParameters]) -> tuple[list[CuffParameters], CuffParameters | None]:
    cuffs = list(cuffs)
    arms, waists = ([cuff for cuff in cuffs if cuff.site == site] for site in ("arm", "waist"))
    if not arms or len(waists) > 1:
        found = ", ".join(f"{cuff.name} ({cuff.site})" for cuff in cuffs) or "none"
        raise SuitError(
            f"an assessment needs arm cuffs and at most one waist cuff and has {found}; fit what is missing"
        )
    return arms, waists[0] if waists else None


def _wearings(suit: Suit, arms: list[CuffParameters], waist: CuffParameters | None) -> list[_Wearing]:
    """Rigid first, then each cuff in each condition; the reference rest length comes after those tried."""
    lengths = np.append(suit.rest_lengths, suit.reference_rest_length)
    yielding = [_Wearing(condition, waist, arm, lengths) for arm in arms for condition in CUFF_CONDITIONS]
    return [_Wearing("rigid", None, None, lengths), *yielding]


def _deviations(wearing: _Wearing, suit: Suit) -> list[_Wearing]:
    """At the reference rest length, either cuff one standard error off along each principal direction of its fit."""
    there = replace(wearing, rest_lengths=np.array([suit.reference_rest_length]))
    waists, arms = ([] if cuff is None else _one_error_off(cuff) for cuff in (wearing.waist, wearing.arm))
    return [*(replace(there, waist=moved) for moved in waists), *(replace(there, arm=moved) for moved in arms)]


def _one_error_off(cuff: CuffParameters) -> list[CuffParameters]:
    """Towards greater stiffness, so that it stays positive; none for a cuff that is given, not fitted."""
    errors = np.sqrt(np.diag(cuff.covariance))
    scale = np.where(errors > 0, errors, 1.0)
    sizes, directions = np.linalg.eigh(cuff.covariance / np.outer(scale, scale))
    moves = (scale[:, None] * directions * np.sqrt(sizes.clip(0))).T
    return [
        replace(
            cuff,
            stiffness=cuff.stiffness + sign * move[0],
            damping=cuff.damping + sign * move[1],
            migration=cuff.migration + sign * move[2],
        )
        for move in moves
        if move.any()
        for sign in [1.0 if move[0] >= 0 else -1.0]
    ]


def _loads(model: Model, suit: Suit, mechanics: Mechanics, forces: list[SuitForces], every: int) -> LoadResponse:
    """First a scenario without load, then one for each rest length of each of the forces."""
    bodies = [model.body_index(point.body) for point in (suit.waist, suit.arm, suit.shoulder)]
    frames = len(mechanics.kinematics.time)
    units = np.zeros((frames, len(bodies), 6, len(model.bodies), 6))
    for place, body in enumerate(bodies):
        units[:, place, :, body] = np.eye(6)
    response = response_to_loads(mechanics.equations, units.reshape(frames, -1, len(model.bodies), 6))
    wrenches = np.concatenate(
        [wrench_about_origin(force.points[:, ::every], force.forces[:, ::every]) for force in forces]
    ).reshape(-1, frames, 6 * len(bodies))
    wrenches = np.concatenate([np.zeros_like(wrenches[:1]), wrenches])
    return LoadResponse(
        acceleration=np.einsum("sfk,fkc->sfc", wrenches, response.acceleration),
        reaction=np.einsum("sfk,fkc->sfc", wrenches, response.reaction),
    )


def _costs(problem: RedundancyProblem, solution: RedundancySolution) -> Array:
    """(scenarios, 2): Σ w x² over all frames, of muscles and of reserves; NaN where a frame is infeasible."""
    muscles = problem.time_constants.shape[1]
    effort = (problem.weights * solution.controls**2).sum(axis=1)
    return np.column_stack([effort[:, :muscles].sum(axis=1), effort[:, muscles:].sum(axis=1)])


def _curves(
    suit: Suit, wearings: list[_Wearing], deviations: list[list[_Wearing]], forces: list[SuitForces], costs: Array
) -> tuple[Curve, ...]:
    """costs (scenarios, 2) of muscles and reserves follow the forces: all wearings, then the deviations of each."""
    parts = np.cumsum([len(force.tension) for force in forces])[:-1]
    remaining = iter(np.split(costs, parts))
    intended = [next(remaining) for _ in wearings]
    deviated = [np.array([next(remaining)[0, 0] for _ in group]) for group in deviations]
    worn = zip(wearings, intended, deviated, forces[: len(wearings)], strict=True)
    return tuple(_curve(suit, wearing, cost, off, force) for wearing, cost, off, force in worn)


def _curve(suit: Suit, wearing: _Wearing, cost: Array, deviated: Array, force: SuitForces) -> Curve:
    """cost (rest lengths, 2) of muscles and reserves; deviated (deviations,) cost of muscles at the reference."""
    return Curve(
        condition=wearing.condition,
        cuff=wearing.arm.name if wearing.arm else None,
        cost=cost[:-1, 0],
        reserve_cost=cost[:-1, 1],
        at_reference=_figure(float(cost[-1, 0]), deviated),
        cord_force=float(force.tension[-1].max()),
        optimum=_optimum(suit.rest_lengths, cost[:-1, 0]),
    )


def _figure(value: float, deviated: Array) -> Figure:
    """A value and its interval by the delta method: changes along independent directions add in squares."""
    if np.isnan(value) or not deviated.size or np.isnan(deviated).any():
        return Figure(None if np.isnan(value) else value)
    reach = NORMAL_95 * float(np.linalg.norm(deviated - value))
    return Figure(value, (value - reach, value + reach))


def _optimum(rest_lengths: Array, cost: Array) -> Optimum:
    """The lowest point of a cubic spline through the lengths tried, and where it keeps 90 % of the saving."""
    from scipy.interpolate import CubicSpline  # slow to import, and needed only here

    best = int(np.argmin(cost))
    if np.isnan(cost).any() or best in {0, len(cost) - 1}:
        return Optimum(Figure(None), Figure(None), Figure(None))
    spline = CubicSpline(rest_lengths, cost)
    flat = spline.derivative().roots(extrapolate=False)
    length = float(flat[np.argmin(spline(flat))])
    lowest = float(spline(length))
    edges = spline.solve(1 - KEPT_REDUCTION * (1 - lowest), extrapolate=False)
    before, after = edges[edges < length], edges[edges > length]
    width = float(after.min() - before.max()) if before.size and after.size and lowest < 1 else None
    return Optimum(Figure(length), Figure(lowest), Figure(width))


def _number(figure: Figure) -> dict[str, Any]:
    return {"value": figure.value, "ci95": list(figure.ci95) if figure.ci95 else None}


def _finite(values: Array) -> list[float | None]:
    return [None if np.isnan(value) else float(value) for value in values]
