"""A motion → the activations that carry it: the muscle-redundancy problem from files to a table."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from solver.model import Model, ModelError
from solver.motion import Kinematics, decimate, differentiate
from solver.redundancy.glenoid import CENTER_MARKER, EDGE_MARKER, HEAD_MARKER
from solver.redundancy.motion import FrameOutcome, MotionSolution, RedundancyOptions, solve_motion
from solver.redundancy.sequence import IN_THE_GLENOID
from solver.suit.suited_model import SuitedModel
from station.assessment.effort import read_effort
from station.assessment.sources import loads_of, model_of, motion_of, named_hash, named_hashes, suited_model_of
from station.progress import Progress, silent
from station.versions import solving_versions

STATUS = tuple(FrameOutcome)
"""A frame's status in a table is its outcome's place in here."""


@dataclass(frozen=True)
class MotionCut:
    """Which part of a motion is solved, times in seconds; cutoff_hz is the low-pass filter's, None without one."""

    cutoff_hz: float | None = 3.0
    start: float | None = None
    end: float | None = None
    every: int = 1


@dataclass(frozen=True)
class MuscleInputs:
    """The files of the problem; a motion of None and the model "bundled" come with the solver."""

    motion: Path | None = None
    model: str = "bundled"
    external_loads: Path | None = None
    effort: Path | None = None

    def hashes(self) -> dict[str, str]:
        """Role → "name SHA-256", or a name alone for what comes with the station."""
        effort = {} if self.effort is None else {"effort": named_hash(self.effort)}
        return named_hashes(self.model, self.motion, self.external_loads) | effort


@dataclass(frozen=True)
class SolvedMotion:
    """Who did the work, in which model, and in `notes` what a reader of the numbers must know to make them again."""

    model: Model
    options: RedundancyOptions
    solution: MotionSolution
    notes: Mapping[str, str]


def solve_muscles(
    inputs: MuscleInputs, cut: MotionCut, options: RedundancyOptions, progress: Progress = silent
) -> SolvedMotion:
    """Files → muscle activations and what comes with them. An effort file overrules the weights of the options."""
    suited = suited_model_of(inputs.model)
    model = model_of(inputs.model) if suited is None else suited.model
    if inputs.effort is not None:
        model, options = read_effort(inputs.effort).applied(model, options)
    ensure_reaction_can_be_asked(model, options)
    whole = differentiate(motion_of(inputs.motion, model), cut.cutoff_hz, cut.start, cut.end)
    kinematics = decimate(whole, cut.every)
    loads = loads_of(inputs.external_loads, model, kinematics.time)
    if suited is not None:
        loads += suited.loads(whole, cut.every)
    solution = solve_motion(
        model, kinematics, options, lambda done, total: progress("solving muscles", done, total), loads
    )
    suit = {} if suited is None else {"suit": _suit_in_words(suited)}
    return SolvedMotion(model, options, solution, inputs.hashes() | suit | _notes(kinematics, options))


def ensure_reaction_can_be_asked(model: Model, options: RedundancyOptions) -> None:
    """Raises ModelError, naming the options, for a model without the joint or without the markers of its socket."""
    obstacles = []
    if options.joint not in (joints := [joint.name for joint in model.joints]):
        obstacles.append(f"has no joint {options.joint}: name one with --joint ({', '.join(joints)})")
    markers = {marker.name for marker in model.markers}
    lacking = [name for name in (CENTER_MARKER, HEAD_MARKER, EDGE_MARKER) if name not in markers]
    if options.has_glenoid_cone and lacking:
        obstacles.append(f"has no marker {', '.join(lacking)}: add what the glenoid is known by, or give --no-glenoid")
    if obstacles:
        raise ModelError(f"the model {model.name} {'; and it '.join(obstacles)}")


def unsolved_in_words(solution: MotionSolution) -> list[str]:
    """A sentence for each way in which frames did not come out solved; of infeasible ones, the smallest violation."""
    sentences = []
    for outcome in STATUS[1:]:
        frames = [index for index, each in enumerate(solution.outcomes) if each is outcome]
        if not frames:
            continue
        words = f"{len(frames)} of {len(solution.outcomes)} frames, the first at {solution.time[frames[0]]:g} s: "
        has_glenoid = bool(np.isfinite(solution.cone_slack[frames]).any())  # infinite where it was not asked for
        words += outcome.value if has_glenoid else outcome.value.replace(IN_THE_GLENOID, "")
        if outcome is FrameOutcome.INFEASIBLE:
            outside = np.maximum(-solution.cone_slack[frames], 0.0)
            missed = solution.equality_residual[frames].max()
            leaves = f"leaves it by up to {outside.max():.3g} N and " if has_glenoid else ""
            words += f"; the smallest violation {leaves}misses accelerations by "
            words += f"up to {missed:.3g} rad/s² or m/s²"
        sentences.append(words)
    return sentences


def _suit_in_words(suited: SuitedModel) -> str:
    cuffs = (("waist", suited.waist), ("arm", suited.arm))
    held = (
        f"{site} cuff {'rigid' if cuff is None else f'{cuff.stiffness:g} N/m, {cuff.damping:g} N s/m'}"
        for site, cuff in cuffs
    )
    return f"cord {suited.suit.stiffness:g} N/m from {suited.suit.reference_rest_length:g} m, {', '.join(held)}"


def _notes(kinematics: Kinematics, options: RedundancyOptions) -> dict[str, str]:
    """In single lines without an equals sign, which OpenSim's files set apart."""
    weights = {
        "muscles": options.muscle_weight,
        "reserves": options.reserve_weight,
        "unweighted": options.unweighted_coordinates,
        "single": dict(options.weights),
    }
    glenoid = (
        f"reaction kept inside, aspect {options.glenoid_aspect:g}" if options.has_glenoid_cone else "not asked for"
    )
    return {
        "made_by": "station rmr",
        "versions": ", ".join(f"{name} {version}" for name, version in solving_versions().items()),
        "filter": kinematics.filter,
        "interval_s": f"{kinematics.interval:.10g}",
        "weights": json.dumps(weights),
        "joint": options.joint,
        "glenoid": glenoid,
        "paths": options.path_mode,
        "free_coordinates": ", ".join(options.free_coordinates) or "none",
        "status_codes": ", ".join(f"{code} {outcome.name.lower()}" for code, outcome in enumerate(STATUS)),
    }
