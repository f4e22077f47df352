"""Fit stiffness and damping of one donning in three dimensions, from pulls along several lines."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from fitting.pull.pull import Pull, of_test
from fitting.results.rendering import Note
from fitting.spatial.held_tensor import held_tensor
from fitting.spatial.swung_tensor import swung_tensor
from fitting.spatial.tensor import NoTensor, Tensor
from fitting.trial.oscillation import Oscillation


@dataclass(frozen=True)
class Tensors:
    """K and C of one donning in three dimensions; None with the reason in no_stiffness and no_damping."""

    stiffness: Tensor | None
    damping: Tensor | None
    no_stiffness: Note | None = None
    no_damping: Note | None = None


def fit_tensors(pulls: Sequence[Pull], swings: Mapping[str, Oscillation]) -> Tensors:
    """K from the static pulls and C from the dynamic ones; swings by file, if they are known."""
    gain_sd = max((pull.trial.gain_sd for pull in pulls), default=0.0)
    stiffness, no_stiffness = _or_reason(lambda: held_tensor(of_test(pulls, "static"), gain_sd))
    damping, no_damping = _or_reason(lambda: swung_tensor(of_test(pulls, "dynamic"), swings, gain_sd))
    return Tensors(stiffness, damping, no_stiffness, no_damping)


def _or_reason(fit: Callable[[], Tensor]) -> tuple[Tensor | None, Note | None]:
    try:
        return fit(), None
    except NoTensor as error:
        return None, error.reason
