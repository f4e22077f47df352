"""Parameters and curves of the muscles with elastic tendons, as compiled code reads them."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from solver.errors import SolverCode
from solver.functions.bezier_chain import INTERVALS, BezierChain
from solver.functions.fibre import DeGrooteFreglyCurves, MillardCurves, SchutteCurves, ThelenCurves
from solver.functions.tendon import DeGrooteFreglyTendon, MillardTendon, ThelenTendon
from solver.model import Model, ModelError, Muscle

Array = NDArray[np.float64]

MILLARD, THELEN, DE_GROOTE = 0, 1, 2
ACTIVE, VELOCITY, PASSIVE, TENDON = 0, 1, 2, 3
LEAST_LENGTH = 0.01  # of the optimal one, OpenSim's for a fibre without pennation
LEAST_ACTIVATION = 0.01  # OpenSim's minimum_activation
LEAST_DE_GROOTE = 0.2  # the length at which its passive force is zero; OpenSim's lower bound


class FiberTables(NamedTuple):
    """n muscles with elastic tendons.

    muscle     (n,) index in Model.muscles;  kind (n,) MILLARD, THELEN or DE_GROOTE
    scales     (n, 7) optimal length [m], slack length [m], height [m], greatest isometric force [N], fastest velocity
               [optimal lengths/s], damping, shortest normalised length
    shapes     (n, 7) figures of the closed curves, as _shapes gives them
    least_activation  (n,) below which the fibre has this one: without damping, nothing else holds a fibre
    corners    (corners, 2, 6) of all Bézier chains, with nodes (corners, intervals + 1) as BezierChain
    corner_range  (n, 4, 2) where a muscle's chain begins and ends: ACTIVE, VELOCITY, PASSIVE, TENDON
    """

    muscle: NDArray[np.int64]
    kind: NDArray[np.int64]
    scales: Array
    shapes: Array
    least_activation: Array
    corners: Array
    nodes: Array
    corner_range: NDArray[np.int64]


def elastic_muscles(model: Model) -> NDArray[np.int64]:
    """Indices of the muscles whose tendons are elastic: those with a curve and a tendon that has a length."""
    is_elastic = [muscle.tendon is not None and muscle.tendon_slack_length > 0.0 for muscle in model.muscles]
    return np.flatnonzero(is_elastic)


@lru_cache(maxsize=32)  # a model is frozen
def fiber_tables(model: Model) -> FiberTables:
    """Raises ModelError if no tendon is elastic, or for a muscle of Schutte, whose tendon is not read."""
    unread = [muscle.name for muscle in model.muscles if isinstance(muscle.curves, SchutteCurves)]
    if unread:
        raise ModelError(
            f"the tendons of {', '.join(unread[:3])} should have a curve and have none: the solver does not read that "
            f"of Schutte1993Muscle_Deprecated; replace {len(unread)} muscles of {model.name} or keep tendons rigid",
            SolverCode.NO_TENDON,
        )
    indices = elastic_muscles(model)
    if not len(indices):
        raise ModelError(
            f"the model {model.name} should have a muscle with an elastic tendon and has none: all have "
            "ignore_tendon_compliance, or no tendon; change the model or keep tendons rigid",
            SolverCode.NO_TENDON,
        )
    muscles = [model.muscles[index] for index in indices]
    stack = _ChainStack()
    ranges = np.array([[stack.range_of(chain) for chain in _chains(muscle)] for muscle in muscles], dtype=np.int64)
    return FiberTables(
        muscle=indices,
        kind=np.array([_kind(muscle) for muscle in muscles]),
        scales=np.array([_scales(muscle) for muscle in muscles]),
        shapes=np.array([_shapes(muscle) for muscle in muscles]),
        least_activation=np.array([0.0 if muscle.fiber_damping else LEAST_ACTIVATION for muscle in muscles]),
        corners=stack.joined("corners", (0, 2, 6)),
        nodes=stack.joined("nodes", (0, INTERVALS + 1)),
        corner_range=ranges,
    )


class _ChainStack:
    """Chains one after another; muscles with the same curve share it."""

    def __init__(self) -> None:
        self._chains: list[BezierChain] = []
        self._ranges: dict[int, tuple[int, int]] = {}
        self._corners = 0

    def range_of(self, chain: BezierChain | None) -> tuple[int, int]:
        """Begin and end of its corners."""
        if chain is None:
            return 0, 0
        if id(chain) not in self._ranges:
            end = self._corners + len(chain.corners)
            self._ranges[id(chain)] = self._corners, end
            self._corners = end
            self._chains.append(chain)
        return self._ranges[id(chain)]

    def joined(self, field: str, empty: tuple[int, ...]) -> Array:
        return np.concatenate([np.zeros(empty), *(getattr(chain, field) for chain in self._chains)])


def _kind(muscle: Muscle) -> int:
    kinds = {MillardCurves: MILLARD, ThelenCurves: THELEN, DeGrooteFreglyCurves: DE_GROOTE}
    return kinds[type(muscle.curves)]


def _chains(muscle: Muscle) -> tuple[BezierChain | None, ...]:
    if isinstance(muscle.curves, MillardCurves) and isinstance(muscle.tendon, MillardTendon):
        return (*muscle.curves.chains, muscle.tendon.chain)
    return (None,) * 4


def _scales(muscle: Muscle) -> tuple[float, ...]:
    optimal = muscle.optimal_fiber_length
    height = optimal * float(np.sin(muscle.pennation_at_optimal))
    least = LEAST_DE_GROOTE if isinstance(muscle.curves, DeGrooteFreglyCurves) else LEAST_LENGTH
    steepest = min(muscle.maximum_pennation, float(np.arccos(1e-3)))  # a fibre across its tendon would bear nothing
    shortest = max(muscle.curves.shortest, height / float(np.sin(steepest)) / optimal, least)
    fastest, slack = muscle.max_contraction_velocity, muscle.tendon_slack_length
    return optimal, slack, height, muscle.max_isometric_force, fastest, muscle.fiber_damping, shortest


def _shapes(muscle: Muscle) -> tuple[float, ...]:
    """In the order in which fiber.py unpacks them; zeros for Millard's, which are chains."""
    match muscle.curves, muscle.tendon:
        case ThelenCurves() as curves, ThelenTendon() as tendon:
            active, passive = curves.active_shape, curves.passive_shape
            speed = curves.velocity_shape, curves.strongest, curves.linear_beyond
            return active, passive, curves.passive_strain, *speed, tendon.strain
        case DeGrooteFreglyCurves() as curves, DeGrooteFreglyTendon() as tendon:
            has_passive = float(curves.has_passive_force)
            return curves.width, curves.passive_strain, has_passive, tendon.shape, 0.0, 0.0, 0.0
        case _:
            return (0.0,) * 7
