"""What is left out of a model, and what that changes in a motion: a note of the results and sentences on stderr."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model import Model
from solver.motion import Kinematics
from solver.redundancy.mechanics import forces_of
from solver.redundancy.motion_solution import MotionSolution
from station.assessment.reserves import LEAST_SHARE, ReserveShares, listed, rms, shares_text, unit_of
from station.messages.codes import AssessmentCode
from station.messages.message import Message

Array = NDArray[np.float64]


@dataclass(frozen=True)
class LeftOutEffect:
    """Root mean squares over the solved frames [N m, N for a translation], by the name of a coordinate.

    loads     of each force that was left out on request and can be computed: its generalised force
    reserves  (of all actuators, needed by inverse dynamics) where the solver lacks forces
    """

    loads: Mapping[str, Mapping[str, float]]
    reserves: ReserveShares

    def note(self) -> str:
        """JSON, in one line; "none" if nothing is known to change."""
        parts = {"loads": self.loads, "reserve_and_needed": self.reserves}
        known = {name: part for name, part in parts.items() if part}
        return json.dumps(known) if known else "none"


NOTHING_LEFT_OUT = LeftOutEffect({}, {})


def effect_of(
    model: Model,
    names: Sequence[str],
    kinematics: Kinematics,
    solution: MotionSolution,
    shares: ReserveShares,
) -> LeftOutEffect:
    """The forces `names` of the model were left out of the solved motion; shares are those of its reserves."""
    is_solved = np.isfinite(solution.reserves).all(axis=1)
    known = {name: forces_of(model, kinematics, name)[is_solved] for name in names}
    return LeftOutEffect(
        {name: _largest(model, forces) for name, forces in known.items()}, shares if model.lacking else {}
    )


def left_out_findings(model: Model, effect: LeftOutEffect | None) -> list[Message[AssessmentCode]]:
    """One that names what is left out and, if it was computed, its effect; none if nothing is."""
    if not model.left_out:
        return []
    described = "" if effect is None else _describe_effect(model, effect)
    return [Message(AssessmentCode.LEFT_OUT, {"parts": ", ".join(model.left_out), "effect": described})]


def _describe_effect(model: Model, effect: LeftOutEffect) -> str:
    """Sentences with a space before each; "" without an effect that is known."""
    sentences = []
    for name, forces in effect.loads.items():
        parts = [f"{size:.3g} {_unit(model, coordinate)} at {coordinate}" for coordinate, size in forces.items()]
        sentences.append(f"{name} would give {listed(parts)} (RMS)." if parts else f"{name} gives nothing here.")
    if model.lacking:
        given = f"give {shares_text(model, effect.reserves)}" if effect.reserves else "give nothing"
        sentences.append(f"Muscles and reserves carry the loads of {', '.join(model.lacking)}; reserves {given}.")
    return "".join(f" {sentence}" for sentence in sentences)


def _largest(model: Model, forces: Array) -> dict[str, float]:
    """By coordinate, the greatest first, down to a hundredth of it."""
    sizes = rms(forces)
    kept = [k for k in np.argsort(-sizes) if sizes[k] > LEAST_SHARE * sizes.max(initial=0.0)]
    return {model.coordinate_names[k]: float(sizes[k]) for k in kept}


def _unit(model: Model, coordinate: str) -> str:
    return unit_of(model, model.coordinate_index(coordinate))
