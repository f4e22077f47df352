"""The solution of the redundancy problem in a motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from itertools import chain
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from documents.equality import EqualByFields
from documents.labelled_arrays import labelled_dataset
from documents.notebook import curves_svg, result_html
from solver.coded_finding import CodedFinding, describe_codes
from solver.multibody.joint_reactions import JointReactions
from solver.muscle import MuscleOutcome
from solver.redundancy.sequence import FrameOutcome

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from solver.tendons.evaluation import ElasticForces

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, repr=False)
class MotionSolution(EqualByFields):
    """Activations and forces in a motion. In INFEASIBLE frames activations, forces and reserves are NaN, and reaction,
    residual and slack those of the point of least violation; in NOT_FINITE frames all are NaN.

    muscles            their names, in the order of every such axis
    time               (frames,) [s]
    activations        (frames, muscles) 0 to 1
    muscle_forces      (frames, muscles) [N], of which passive_forces (frames, muscles) [N]
    reserves           (frames, actuators) of Model.actuators [N or N m]
    reaction           (frames, 6) moment [N m] and force [N] on the parent of the options' joint, in ground: on the
                       scapula at the glenohumeral joint
    contact            (frames, 2) where it meets the glenoid's plane [m], as glenoid.contact_points; NaN where it does
                       not, or the model has no markers of the glenoid
    effort             (frames,) Σ w aᵖ + Σ w r²
    equality_residual  (frames,) largest acceleration not produced [rad/s² or m/s²], mostly by the constraint, of the
                       coordinate with the name residual_coordinates (frames,)
    cone_slack         (frames,) distance of the reaction inside the cone [N], infinite without the glenoid constraint
    outcomes           (frames,) of FrameOutcome
    muscle_outcomes    (frames, muscles) of MuscleOutcome: whether path and force of each muscle converged
    joint_reactions    of the options' reactions; NaN in frames that are INFEASIBLE or NOT_FINITE
    fibers             their lengths and forces with elastic tendons; None with rigid ones
    findings           of cuffstation.solve_motion: on motion and loads, and large reserves
    """

    muscles: tuple[str, ...]
    time: Array
    activations: Array
    muscle_forces: Array
    passive_forces: Array
    reserves: Array
    reaction: Array
    contact: Array
    effort: Array
    equality_residual: Array
    residual_coordinates: tuple[str, ...]
    cone_slack: Array
    outcomes: tuple[FrameOutcome, ...]
    muscle_outcomes: NDArray[np.object_]
    joint_reactions: JointReactions
    fibers: ElasticForces | None = None
    findings: tuple[CodedFinding, ...] = ()

    @property
    def unsolved(self) -> int:
        """Number of frames that are not SOLVED."""
        return sum(outcome is not FrameOutcome.SOLVED for outcome in self.outcomes)

    def frames_with(self, outcome: MuscleOutcome) -> NDArray[np.bool_]:
        """(frames,) whether the path or the force of any muscle ended so."""
        is_ended_so: NDArray[np.bool_] = (self.muscle_outcomes == outcome).any(axis=1)
        return is_ended_so

    def __repr__(self) -> str:
        has_effort = np.isfinite(self.effort)
        sizes = "no frame with an effort"
        if has_effort.any():
            force = np.linalg.norm(self.reaction[has_effort, 3:], axis=1)
            sizes = f"mean effort {self.effort[has_effort].mean():.4g}, joint reaction up to {force.max():.0f} N"
        return (
            f"MotionSolution: {len(self.time)} frames, {self.unsolved} not solved, {len(self.muscles)} muscles\n"
            f"  {sizes}{describe_codes(self.findings)}"
        )

    def to_dataframe(self) -> pd.DataFrame:
        """A row per frame: time_s, an activation (0 to 1) per muscle by its name, effort, reaction_n (its size [N]),
        and the size of each of the joint_reactions by its label, as reaction_n.knee_r_on_tibia_r_in_ground.
        """
        import pandas as pd

        table = pd.DataFrame(self.activations, columns=list(self.muscles))
        table.insert(0, "time_s", self.time)
        table["effort"], table["reaction_n"] = self.effort, np.linalg.norm(self.reaction[:, 3:], axis=1)
        for label, force in zip(self.joint_reactions.labels, self.joint_reactions.force.swapaxes(0, 1), strict=True):
            table[f"reaction_n.{label}"] = np.linalg.norm(force, axis=1)
        table.attrs["units"] = {"time_s": "s"} | {
            name: "N" for name in map(str, table) if name.startswith("reaction_n")
        }
        return table

    def to_xarray(self) -> xr.Dataset:
        """activations and forces (time, muscle), effort (time), reaction (time, component). Needs the extra xarray."""
        per_muscle = ("time", "muscle")
        variables = {
            "activations": (per_muscle, self.activations, ""),
            "muscle_forces": (per_muscle, self.muscle_forces, "N"),
            "passive_forces": (per_muscle, self.passive_forces, "N"),
            "effort": (("time",), self.effort, ""),
            "reaction_force": (("time", "axis"), self.reaction[:, 3:], "N"),
            "reaction_moment": (("time", "axis"), self.reaction[:, :3], "N m"),
        }
        axes = {"time": (self.time, "s"), "muscle": (self.muscles, ""), "axis": (("x", "y", "z"), "")}
        return labelled_dataset(variables, axes)

    def _repr_html_(self) -> str:
        peaks = np.nanmax(self.activations, axis=0, initial=0.0)
        strongest = np.argsort(peaks)[::-1][:5]
        rows = [(self.muscles[muscle], f"{peaks[muscle]:.2f}") for muscle in strongest]
        drawing = curves_svg([(self.time, self.activations[:, muscle]) for muscle in strongest], "s", "activation")
        title, remark = repr(self).split("\n")
        return result_html(title, ("muscle", "largest activation"), rows, remark.strip(), drawing)


def joined(parts: Sequence[MotionSolution]) -> MotionSolution:
    """One solution of consecutive parts of a motion with rigid tendons."""
    first = parts[0]
    return replace(
        first,
        **_joined_arrays(parts),
        outcomes=tuple(chain.from_iterable(part.outcomes for part in parts)),
        residual_coordinates=tuple(chain.from_iterable(part.residual_coordinates for part in parts)),
        joint_reactions=replace(first.joint_reactions, **_joined_arrays([part.joint_reactions for part in parts])),
    )


def _joined_arrays(parts: Sequence[MotionSolution] | Sequence[JointReactions]) -> dict[str, Any]:
    """By the name of a field; frames are the first axis of all of them."""
    names = [field.name for field in fields(parts[0]) if isinstance(getattr(parts[0], field.name), np.ndarray)]
    return {name: np.concatenate([getattr(part, name) for part in parts]) for name in names}
