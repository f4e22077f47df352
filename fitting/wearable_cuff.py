"""A cuff as a suit wears it: its figures and what is known of them, from a fit or from a cuffs.json."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fitting.errors import FitError
from fitting.results.codes import NoteCode, Verdict
from fitting.results.note import Note
from fitting.results.rendering import sentence_of, verdict_text
from fitting.seal import Standing
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = {"stiffness": "stiffness_n_per_m", "damping": "damping_n_s_per_m", "migration": "migration_m"}
"""Field of WearableCuff and CuffFit → key in cuffs.json, in the order of CuffParameters' covariance."""
KNOWN_LAW, TENSOR = "kelvin_voigt", "tensor"
"""Names of laws in cuffs.json: F = k x + c ẋ along one line, and in three dimensions."""
UNITS = {"stiffness": "N/m", "damping": "N s/m", "migration": "m"}


class NotIdentified(FitError):
    """A cuff lacks a figure that was asked for; one sentence says which and why."""


@dataclass(frozen=True, repr=False)
class WearableCuff:
    """k [N/m], c [N s/m] and migration [m] of a cuff, None where there is no figure.

    missing     the quantities that are not there, or are not identified: nobody should wear them
    covariance  (3, 3) of (stiffness, damping, migration); zero where one is None or was given
    law         extensions of the law F = k x + c ẋ that its trials or its file name, none for that law alone
    sources     file → SHA-256 of every recording that the figures are from
    origin      of those recordings: simulated if any of them is, unknown where the figures were given
    given       which of the figures were given by hand;  standing  against the seal of its file, None for a fit
    assumed     what was assumed to make it wearable;  notes  what a reader should know, in sentences
    """

    name: str
    site: Literal["arm", "waist"]
    donning: str
    stiffness: Estimate | None
    damping: Estimate | None
    migration: Estimate | None
    missing: tuple[str, ...]
    verdicts: tuple[Verdict, ...]
    covariance: NDArray[np.float64]
    law: tuple[str, ...] = ()
    sources: Mapping[str, str] = field(default_factory=dict)
    origin: DataOrigin = DataOrigin.UNKNOWN
    given: tuple[str, ...] = ()
    standing: Standing | None = None
    assumed: tuple[Note, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def verdict(self) -> str:
        """All verdicts as one text."""
        return verdict_text(self.verdicts)

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader must know of where the figures come from, in clauses."""
        simulated = ("simulated data",) if self.origin is DataOrigin.SIMULATED else ()
        by_hand = tuple(
            f"{name} {estimate.value:.6g} {UNITS[name]} is given by hand"
            for name, estimate in self._estimates().items()
            if name in self.given and estimate
        )
        changed = ("changed since it was fitted",) if self.standing is Standing.CHANGED else ()
        return simulated + by_hand + changed

    def __repr__(self) -> str:
        rows = (
            self.to_dataframe().drop(columns=["cuff", "donning"]).to_string(index=False, float_format="{:.4g}".format)
        )
        return f"Cuff {self.name}, donning {self.donning}: {self.verdict}\n{rows}"

    def to_dataframe(self) -> pd.DataFrame:
        """A row per quantity, with its unit, value, standard_error, ci95_low, ci95_high and is_identified."""
        import pandas as pd

        return pd.DataFrame([self._row(name, estimate) for name, estimate in self._estimates().items()])

    def parameters(self) -> CuffParameters:
        """For the solver. Raises NotIdentified if a figure is missing."""
        if self.missing or self.stiffness is None or self.damping is None or self.migration is None:
            raise NotIdentified(
                f"cuff {self.name} has no {' and no '.join(self.missing)} to be relied on ({self.verdict}); measure it "
                "or write a value with its standard_error into cuffs.json"
            )
        return CuffParameters(
            name=self.name,
            site=self.site,
            stiffness=self.stiffness.value,
            damping=self.damping.value,
            migration=self.migration.value,
            covariance=self.covariance,
            source=" ".join(self.sources.values()) or sentence_of(Verdict.GIVEN),
        )

    def without_migration(self) -> WearableCuff:
        """The cuff as if it did not migrate, where migration is all that is missing; else as it is."""
        if self.missing != ("migration",):
            return self
        none = Estimate(0.0, 0.0, (0.0, 0.0))
        return replace(self, migration=none, missing=(), assumed=(*self.assumed, Note(NoteCode.NO_SHIFT)))

    def _estimates(self) -> dict[str, Estimate | None]:
        return dict(zip(UNITS, (self.stiffness, self.damping, self.migration), strict=True))

    def _row(self, name: str, estimate: Estimate | None) -> dict[str, Any]:
        low, high = estimate.ci95 if estimate else (np.nan, np.nan)
        return {
            "cuff": self.name,
            "donning": self.donning,
            "quantity": name,
            "unit": UNITS[name],
            "value": estimate.value if estimate else np.nan,
            "standard_error": estimate.standard_error if estimate else np.nan,
            "ci95_low": low,
            "ci95_high": high,
            "is_identified": name not in self.missing,
        }


def covariance_of(estimates: Sequence[Estimate | None]) -> NDArray[np.float64]:
    """Diagonal covariance of independent estimates, 0 where there is none."""
    return np.diag([estimate.standard_error**2 if estimate else 0.0 for estimate in estimates])
