"""A pull that was used, with its fits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from documents.results import EqualByFields
from fitting.dynamic.damping import DampingFit, Swings
from fitting.pull.plateaus import Plateau
from fitting.pull.pull import Pull, newest_first, of_test
from fitting.static.held_loads import HeldLoads
from fitting.static.stiffness import StaticFit
from fitting.trial.oscillation import Oscillation


@dataclass(frozen=True, eq=False)
class FittedPull(EqualByFields):
    """A pull with its fits: the arrays behind the figures of a trial.

    static   held loads and their lines (stiffness of the donning, an offset per segment), None for a dynamic trial
    dynamic  fitted motion and damper force over velocity, None for a static trial
    """

    pull: Pull
    static: StaticFit | None = None
    dynamic: DampingFit | None = None

    def __repr__(self) -> str:
        fits = [name for name in ("static", "dynamic") if getattr(self, name) is not None]
        return f"FittedPull of {self.pull.trial!r}, with the fields pull, {', '.join(fits)}"

    @property
    def plateaus(self) -> tuple[Plateau, ...]:
        """The held loads, without the drift of the cell's zero; empty for a dynamic trial."""
        return self.static.plateaus if self.static else ()

    @property
    def oscillation(self) -> Oscillation | None:
        """The stretch of a dynamic trial that was fitted."""
        return self.dynamic.oscillation if self.dynamic else None


def fitted_pulls(
    pulls: Sequence[Pull], static: Sequence[Pull], held: HeldLoads, swings: Swings
) -> dict[str, FittedPull]:
    """File → pull and fits, in the order of pulls; static are those that were fitted as held loads."""
    lines = dict(zip([pull.trial.file for pull in static], held.stiffness.trials, strict=True))
    return {
        file: FittedPull(pull, lines.get(file), swings.by_file.get(file))
        for pull in pulls
        if (file := pull.trial.file) in lines or file in swings.by_file
    }


def used_pulls(fitted: Mapping[str, FittedPull], pulls: Sequence[Pull]) -> dict[str, Pull]:
    """File → used pull: the fitted ones, and along other lines the newest run of each repeat."""
    newest = [runs[0] for test in ("static", "dynamic") for runs in newest_first(of_test(pulls, test))]
    others = {pull.trial.file: pull for pull in newest if pull.is_along_another_line}
    return {file: fit.pull for file, fit in fitted.items()} | others
