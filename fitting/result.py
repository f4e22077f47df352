"""What a fit says about a cuff: estimates, verdicts, provenance."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fitting.calibration import Calibration
from fitting.curves import TrialCurves
from fitting.dynamic.damping import DampingFit
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.diagnosis import Diagnosis
from fitting.laws.model_class import ModelComparison
from fitting.results.codes import DOUBTED, CauseCode, Verdict
from fitting.results.note import Note
from fitting.results.rendering import verdict_text
from fitting.seal import CheckedFile
from fitting.spatial.tensor import Tensors
from fitting.timing.sync_certificate import SyncCertificate
from fitting.trial import RejectedTrial
from fitting.uncertainty import Estimate
from fitting.wearable_cuff import QUANTITIES, TENSOR, WearableCuff
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters

if TYPE_CHECKING:
    import pandas as pd


@dataclass(frozen=True)
class Lag:
    """Of force against markers [s], as it was taken off the force's times, and its standard uncertainties.

    delay_sd   of what all trials share;  edge_sd  of what is each trial's own;  drift  [s/s] of one clock's rate
    source     "declared", or the files of the bounce trials that calibrated it
    """

    value: float
    delay_sd: float
    edge_sd: float
    drift: float
    source: str


@dataclass(frozen=True)
class TrialFit:
    """One recording's part in a fit: "used", "superseded" by a later run, or "unusable" for a reason.

    The estimates are from this trial alone, None where it says nothing; swing is all that a dynamic one says.
    sync        what the edges of the sync line are worth, None without one
    origin      measured or simulated, as the devices said of themselves
    zero_drift  [N] of the force at rest from start to end, None where the trial does not rest at both
    damage      of the file, beyond a cut; then nothing else is said of the trial
    """

    file: str
    sha256: str
    test: str
    repeat: int
    run: int
    state: Literal["used", "superseded", "unusable"]
    reason: str = ""
    notes: tuple[str, ...] = ()
    stiffness: Estimate | None = None
    damping: Estimate | None = None
    migration: Estimate | None = None
    swing: DampingFit | None = None
    sync: SyncCertificate | None = None
    zero_drift: float | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN
    damage: tuple[str, ...] = ()


@dataclass(frozen=True, repr=False)
class CuffFit:
    """A cuff's k [N/m], c [N s/m] and migration [m] of one donning; verdicts say what of it is not identified.

    None where the trials give no figure. One that is not identified is given with its interval, and is `missing`.

    covariance  (3, 3) of (stiffness, damping, migration); zero where one is None
    sources     file → SHA-256 of every recording that was used
    trials      every recording of the donning
    notes       what a reader should know; diagnostics are numbers in SI with the unit in the key
    lag         of force against markers
    held        what held loads say beside the straight line, as cuffs.json has it
    energy      J that the cuff takes in a cycle of the dynamic trials
    complex_stiffness  K* in bands of frequency from all dynamic trials
    classes     how laws richer than a spring and a damper compare;  diagnosis: checks and what may be wrong
    origin      of the recordings that were used: simulated if any of them is
    tensors     K and C in three dimensions, or why there are none
    """

    name: str
    site: Literal["arm", "waist"]
    donning: str
    stiffness: Estimate | None
    damping: Estimate | None
    migration: Estimate | None
    verdicts: tuple[Verdict, ...]
    covariance: NDArray[np.float64]
    sources: Mapping[str, str] = field(default_factory=dict)
    trials: tuple[TrialFit, ...] = ()
    notes: tuple[Note, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    lag: Lag | None = None
    held: Mapping[str, Any] = field(default_factory=dict)
    energy: Estimate | None = None
    complex_stiffness: tuple[ComplexStiffness, ...] = ()
    classes: ModelComparison | None = None
    diagnosis: Diagnosis | None = None
    tensors: Tensors | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN

    def wearable(self) -> WearableCuff:
        """The cuff as a suit wears it."""
        tensors = self.tensors and (self.tensors.stiffness or self.tensors.damping)
        return WearableCuff(
            name=self.name,
            site=self.site,
            donning=self.donning,
            stiffness=self.stiffness,
            damping=self.damping,
            migration=self.migration,
            missing=self.missing,
            verdicts=self.verdicts,
            covariance=self.covariance,
            law=(self.classes.chosen if self.classes else ()) + ((TENSOR,) if tensors else ()),
            sources=self.sources,
            origin=self.origin,
            notes=tuple(map(str, self.notes)),
        )

    def parameters(self) -> CuffParameters:
        """For the solver. Raises NotIdentified if a figure is missing."""
        return self.wearable().parameters()

    def __repr__(self) -> str:
        return repr(self.wearable())

    def to_dataframe(self) -> pd.DataFrame:
        """A row per quantity, with its unit, value, standard_error, ci95_low, ci95_high and is_identified."""
        return self.wearable().to_dataframe()

    @property
    def verdict(self) -> str:
        """All verdicts as one text."""
        return verdict_text(self.verdicts)

    @property
    def missing(self) -> tuple[str, ...]:
        """The quantities that nobody should wear: not there, or not identified."""
        doubted = {name for verdict in self.verdicts for name in DOUBTED.get(verdict, ())}
        return tuple(name for name in QUANTITIES if getattr(self, name) is None or name in doubted)


@dataclass(frozen=True, repr=False)
class SessionFit:
    """All cuffs of a session.

    donnings  cuff → donning → fit, donnings in the order they were recorded
    rejected  recordings that could not be read as a trial at all
    curves    file → the arrays behind the figures, for every trial that was used
    calibration  of the load cell by the session's bounce trials, None without one
    recordings   file → its hash, and how it stood to what was recorded of it; also of those that were set aside
    """

    donnings: Mapping[str, Mapping[str, CuffFit]]
    rejected: tuple[RejectedTrial, ...]
    curves: Mapping[str, TrialCurves]
    calibration: Calibration | None = None
    recordings: Mapping[str, CheckedFile] = field(default_factory=dict)

    @property
    def cuffs(self) -> dict[str, CuffFit]:
        """Each cuff as last donned."""
        return {name: list(fits.values())[-1] for name, fits in self.donnings.items()}

    def __repr__(self) -> str:
        lines = [f"Session: {len(self.donnings)} cuffs, {len(self.rejected)} recordings not used"]
        return "\n".join([*lines, *map(repr, self.cuffs.values())])

    def to_dataframe(self) -> pd.DataFrame:
        """As CuffFit.to_dataframe, of every donning of every cuff."""
        import pandas as pd

        tables = [fit.to_dataframe() for fits in self.donnings.values() for fit in fits.values()]
        return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()

    @property
    def origin(self) -> DataOrigin:
        """Simulated if any cuff's is."""
        return DataOrigin.joined(fit.origin for fits in self.donnings.values() for fit in fits.values())

    @property
    def damage(self) -> dict[str, tuple[str, ...]]:
        """File → what is damaged in it, of every recording that is."""
        fits = [fit for donnings in self.donnings.values() for fit in donnings.values()]
        found = {trial.file: trial.damage for trial in self.rejected}
        found |= {trial.file: trial.damage for fit in fits for trial in fit.trials}
        return {file: damage for file, damage in found.items() if damage}


def with_diagnosis(fit: CuffFit, diagnosis: Diagnosis) -> CuffFit:
    """The fit with its diagnosis; what that calls wrong, no verdict calls identified."""
    verdicts = {CauseCode.GAIN: Verdict.SCALE, CauseCode.SKIN: Verdict.SKIN}
    wrong = tuple(verdicts[cause.code] for cause in diagnosis.causes if cause.code in verdicts)
    kept = tuple(verdict for verdict in fit.verdicts if not (wrong and verdict is Verdict.IDENTIFIED))
    return replace(fit, verdicts=kept + wrong, classes=diagnosis.classes, diagnosis=diagnosis)
