"""Muscles of all scenarios in one frame: geometry and response maps are computed once, a scenario changes the loads.

Rates of cord and cuffs are the differences over one interval that the offline assessment takes; the neighbouring
postures are extrapolated from q, q̇ and q̈, so that they need no frame beside this one.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from solver.cuff import CuffParameters
from solver.errors import SolverCode, SolverError
from solver.model import Array, Model, ModelError
from solver.motion import Kinematics
from solver.multibody.postures import postures, wrench_about_origin
from solver.muscle import PathState
from solver.redundancy.effort import RedundancyOptions, effort_weights
from solver.redundancy.mechanics import Mechanics, evaluate_motion, glenoid_cone
from solver.redundancy.problem import LoadResponse, RedundancyProblem, build_redundancy, ensure_solvable
from solver.redundancy.sequence import FrameByFrame
from solver.stream.stream_frame import StreamNotice, StreamSuitFrame, StreamSuitOutcome
from solver.suit.cord import (
    Condition,
    CordLine,
    SuitScenario,
    cord_line,
    per_unit_wrench,
    response_to_wrenches,
    suit_forces,
)
from solver.suit.suit import Suit, SuitError, ensure_fits, with_suit_masses

_NEIGHBOURS = {"backward": (-1.0, 0.0), "central": (-1.0, 0.0, 1.0)}
_AT = 1  # the frame itself, among these
SLACK = float("inf")
"""Rest length of a cord that never pulls: the suit is worn, with its masses, and does nothing."""


class FrameMuscles:
    """Solves frames in the order of time; each starts from the activations of the frame before.

    scenarios  name → suit that is worn, None for the body without;  notices  results that the model cannot give
    """

    def __init__(
        self,
        model: Model,
        scenarios: Mapping[str, StreamScenario | None],
        suit: Suit | None,
        options: RedundancyOptions,
    ) -> None:
        if scenarios:
            _ensure_solvable(model, options)
        options, self.notices = _possible_options(model, options)
        self._worn = {name: worn for name, worn in scenarios.items() if worn is not None}
        if suit is None and self._worn:
            raise SuitError("a scenario that wears the suit needs a Suit and there is none; pass suit")
        if suit is not None:
            ensure_fits(suit, model)
        self._suit, self._order = suit, tuple(scenarios)
        self._bare = _Body(model, [name for name in scenarios if name not in self._worn], options, self.notices)
        suited = with_suit_masses(model, suit) if suit is not None else model
        self._suited = _Body(suited, list(self._worn), options, self.notices)

    def set_rest_length(self, scenario: str, rest_length: float) -> None:
        """Change the rest length of a scenario [m], from the next frame on. Raises SuitError for one without a suit.

        Activations of that frame may be anything: a limit of their rate would show a transient, because no wearer's
        cord changes in an instant.
        """
        if scenario not in self._worn or not rest_length > 0:
            raise SuitError(
                f"a rest length above 0 m of a scenario with a suit ({', '.join(self._worn) or 'none'}) was expected, "
                f"found {rest_length:g} m of {scenario}; correct it",
                SolverCode.SUIT_KEY,
            )
        self._worn[scenario] = replace(self._worn[scenario], rest_length=rest_length)
        self._suited.forget(scenario)

    def solve(self, time: float, state: Array, interval: float) -> dict[str, StreamSuitFrame]:
        """Muscles at time [s], state (3, coordinates) q, q̇, q̈; rates of cord and cuffs are differences over the
        interval [s], as in the offline assessment.
        """
        kinematics = Kinematics(np.array([time]), interval, state[0][None], state[1][None], state[2][None], None)
        found: dict[str, StreamSuitFrame] = {}
        paths = None
        if self._bare.names:
            evaluated = self._bare.evaluate(kinematics, None)
            found |= self._bare.solve(evaluated, {})
            paths = evaluated[0].paths if evaluated else None
        if self._suit is not None and self._worn:
            evaluated = self._suited.evaluate(kinematics, paths)
            forces = suit_forces_of_frame(self._suit, self._suited.model, state, interval, self._worn)
            found |= self._suited.solve(evaluated, forces, self._suit)
        return {name: found[name] for name in self._order}


_Evaluated = tuple[Mechanics, RedundancyProblem]


class _Body:
    """A model, bare or with the masses of the suit, and the scenarios in which it is solved."""

    def __init__(
        self, model: Model, names: Sequence[str], options: RedundancyOptions, notices: frozenset[StreamNotice]
    ) -> None:
        self.model, self.names = model, names
        self._options, self._notices = options, notices
        self._frames = FrameByFrame(len(names), len(model.muscles))
        self._strength = np.array([actuator.optimal_force for actuator in model.actuators])
        self._glenoid = (
            None if StreamNotice.NO_GLENOID_CONE in notices else glenoid_cone(model, joint_name=options.joint)
        )

    def forget(self, name: str) -> None:
        """Start a scenario anew."""
        self._frames.forget(self.names.index(name))

    def evaluate(self, kinematics: Kinematics, paths: PathState | None) -> _Evaluated | None:
        """None where the model has no finite accelerations."""
        joint, path_mode = self._options.joint, self._options.path_mode
        try:
            mechanics = evaluate_motion(self.model, kinematics, paths, joint=joint, path_mode=path_mode)
            return mechanics, build_redundancy(self.model, mechanics, self._options)
        except SolverError:
            return None

    def solve(
        self, evaluated: _Evaluated | None, forces: Mapping[str, FrameForces], suit: Suit | None = None
    ) -> dict[str, StreamSuitFrame]:
        """By the name of a scenario; with a suit, one without forces has no equilibrium."""
        if evaluated is None:
            return dict.fromkeys(self.names, self._without(StreamSuitOutcome.NOT_FINITE))
        mechanics, problem = evaluated
        solution = self._frames.solve(problem, self._loads(mechanics, forces, suit))
        controls, reaction = solution.controls[:, 0], solution.reaction[:, 0, 3:]
        if StreamNotice.NO_GLENOHUMERAL_JOINT in self._notices:
            reaction = np.full_like(reaction, np.nan)
        in_glenoid = self._in_glenoid(mechanics, reaction)
        count, found = len(self.model.muscles), {}
        cost = problem.effort.terms(controls)
        for place, name in enumerate(self.names):
            if suit is not None and name not in forces:
                self._frames.forget(place)
                found[name] = self._without(StreamSuitOutcome.CUFF_NOT_AT_REST)
                continue
            worn = forces.get(name)
            found[name] = StreamSuitFrame(
                outcome=StreamSuitOutcome(solution.outcomes[place, 0]),
                activations=controls[place, :count],
                reserves=controls[place, count:] * self._strength,
                cord_force_n=worn.tension if worn else 0.0,
                cuff_shift_m=worn.shift if worn else np.zeros(2),
                glenohumeral_force_n=reaction[place],
                glenohumeral_force_in_glenoid_n=in_glenoid[place],
                effort=float(cost[place, :count].sum()),
                reserve_effort=float(cost[place, count:].sum()),
            )
        return found

    def _loads(self, mechanics: Mechanics, forces: Mapping[str, FrameForces], suit: Suit | None) -> LoadResponse:
        if suit is None:
            count = len(self.names)
            return LoadResponse(np.zeros((count, 1, len(self.model.coordinates))), np.zeros((count, 1, 6)))
        nothing = np.zeros(18)
        wrenches = [forces[name].wrench if name in forces else nothing for name in self.names]
        return response_to_wrenches(per_unit_wrench(self.model, suit, mechanics), np.array(wrenches)[:, None])

    def _in_glenoid(self, mechanics: Mechanics, reaction: Array) -> Array:
        """(scenarios, 3) compression, shear towards the edge marker and across it."""
        if self._glenoid is None:
            return np.full_like(reaction, np.nan)
        found: Array = reaction @ mechanics.state.rotation_to_ground[0, self._glenoid.body] @ self._glenoid.frame.T
        return found

    def _without(self, outcome: StreamSuitOutcome) -> StreamSuitFrame:
        def nothing(*shape: int) -> Array:
            return np.full(shape, np.nan)

        return StreamSuitFrame(
            outcome=outcome,
            activations=nothing(len(self.model.muscles)),
            reserves=nothing(len(self._strength)),
            cord_force_n=np.nan,
            cuff_shift_m=nothing(2),
            glenohumeral_force_n=nothing(3),
            glenohumeral_force_in_glenoid_n=nothing(3),
            effort=np.nan,
            reserve_effort=np.nan,
        )


def _ensure_solvable(model: Model, options: RedundancyOptions) -> None:
    """Raises ModelError for what would otherwise fail in the first frame: no muscles, or names that are not there."""
    ensure_solvable(model, options)
    if options.tendons == "elastic":
        raise ModelError(
            "muscles are solved with rigid tendons while a motion is recorded, and elastic ones were requested; "
            "solve the recorded motion with them",
            SolverCode.UNSUPPORTED,
        )
    for name in options.free_coordinates:
        model.coordinate_index(name)
    effort_weights(model, options)


def _possible_options(model: Model, options: RedundancyOptions) -> tuple[RedundancyOptions, frozenset[StreamNotice]]:
    """Options that the model can meet: the reaction of another joint, and no cone."""
    notices: set[StreamNotice] = set()
    if options.joint not in [joint.name for joint in model.joints]:
        notices.add(StreamNotice.NO_GLENOHUMERAL_JOINT)
        options = replace(options, joint=model.joints[-1].name)
    try:
        glenoid_cone(model, joint_name=options.joint)
    except ModelError:
        notices.add(StreamNotice.NO_GLENOID_CONE)
        return replace(options, has_glenoid_cone=False), frozenset(notices)
    glenoid_cone(model, options.glenoid_aspect, options.joint)  # refuses an aspect that is not positive
    return options, frozenset(notices)


@dataclass(frozen=True, eq=False)
class FrameForces:
    """tension of the cord [N], shift (2,) of waist and arm cuff from where they were put on [m], wrench (18,) on the
    bodies of waist, arm and shoulder, as response_to_wrenches takes it.
    """

    tension: float
    shift: Array
    wrench: Array


def suit_forces_of_frame(
    suit: Suit, model: Model, state: Array, interval: float, scenarios: Mapping[str, StreamScenario]
) -> dict[str, FrameForces]:
    """By the name of a scenario; one whose cuffs have no equilibrium is missing. state (3, coordinates) q, q̇, q̈."""
    steps = interval * np.array(_NEIGHBOURS[suit.rate])[:, None]
    q, u, a = state
    near = postures(model, q + steps * (u + 0.5 * steps * a), u + steps * a)
    line = cord_line(suit, model, near, interval)
    found: dict[str, FrameForces] = {}
    for names in _with_the_same_cuffs(scenarios):
        try:
            found |= _forces(suit, line, scenarios, names)
        except SuitError:  # of one of them: find out which
            for name in names:
                try:
                    found |= _forces(suit, line, scenarios, [name])
                except SuitError:
                    continue
    return found


def _with_the_same_cuffs(scenarios: Mapping[str, StreamScenario]) -> list[list[str]]:
    """Names of scenarios that differ in the rest length only: they are evaluated together."""
    groups: dict[tuple[object, ...], list[str]] = {}
    for name, worn in scenarios.items():
        groups.setdefault((worn.condition, id(worn.waist), id(worn.arm)), []).append(name)
    return list(groups.values())


def _forces(
    suit: Suit, line: CordLine, scenarios: Mapping[str, StreamScenario], names: Sequence[str]
) -> dict[str, FrameForces]:
    worn = scenarios[names[0]]
    lengths = np.array([scenarios[name].rest_length for name in names])
    scenario = SuitScenario(worn.condition, worn.waist, worn.arm, lengths)
    forces = suit_forces(suit, line, lengths, scenario.cuffs, is_shifted=scenario.is_shifted, yields=scenario.yields)
    migration = np.array([cuff.migration if cuff and scenario.is_shifted else 0.0 for cuff in scenario.cuffs])
    wrenches = wrench_about_origin(forces.points[:, _AT], forces.forces[:, _AT]).reshape(len(names), -1)
    shifts = np.linalg.norm(forces.displacement[:, _AT], axis=-1) + migration
    return {
        name: FrameForces(float(forces.tension[place, _AT]), shifts[place], wrenches[place])
        for place, name in enumerate(names)
    }


@dataclass(frozen=True)
class StreamScenario:
    """The suit at one rest length [m], with these cuffs (None is a rigid one) in this condition.

    All scenarios of a solver share its Suit, so its cord and masses. The condition is as in SuitScenario: "rigid",
    "shift" (with migration), "visco_elastic" (with compliance) or "both".
    """

    rest_length: float = SLACK
    condition: Condition = "rigid"
    waist: CuffParameters | None = None
    arm: CuffParameters | None = None
