"""What a fit says about a cuff: estimates, verdicts, provenance; and the text of cuffs.json."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from fitting.calibration import Calibration
from fitting.curves import TrialCurves
from fitting.dynamic.damping import DampingFit
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.errors import FitError
from fitting.laws.diagnosis import Diagnosis
from fitting.laws.model_class import ModelComparison
from fitting.plain import (
    plain_bands,
    plain_calibration,
    plain_classes,
    plain_diagnosis,
    plain_estimate,
    plain_swing,
    plain_sync,
)
from fitting.results.codes import DOUBTED, CauseCode, Verdict
from fitting.results.rendering import sentence_of, verdict_text
from fitting.seal import SEAL, CheckedFile, Standing, digest, seal_cuff
from fitting.spatial.tensor import Tensors, plain_tensor
from fitting.timing.sync_certificate import SyncCertificate
from fitting.trial import RejectedTrial
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters

if TYPE_CHECKING:
    import pandas as pd

QUANTITIES = {"stiffness": "stiffness_n_per_m", "damping": "damping_n_s_per_m", "migration": "migration_m"}
"""Field of CuffFit → key in cuffs.json, in the order of CuffParameters' covariance."""
UNITS = {"stiffness": "N/m", "damping": "N s/m", "migration": "m"}


class NotIdentified(FitError):
    """A cuff lacks a figure that was asked for; one sentence says which and why."""


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

    covariance  (3, 3) of (stiffness, damping, migration); zero where one is None or was given
    sources     file → SHA-256 of every recording that was used
    trials      every recording of the donning; not read back from cuffs.json
    notes       sentences a reader should know; diagnostics are numbers in SI with the unit in the key
    lag         of force against markers, None where the figures were given
    held        what held loads say beside the straight line, as cuffs.json has it
    energy      J that the cuff takes in a cycle of the dynamic trials
    complex_stiffness  K* in bands of frequency from all dynamic trials
    classes     how laws richer than a spring and a damper compare;  diagnosis: checks and what may be wrong
    origin      of the recordings that were used: simulated if any of them is, unknown where the figures were given
    given       which of the figures were given by hand;  standing: against its seal in cuffs.json, None unless read
    tensors     K and C in three dimensions, or why there are none
                (these four are not read back from cuffs.json)
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
    notes: tuple[str, ...] = ()
    diagnostics: Mapping[str, float] = field(default_factory=dict)
    lag: Lag | None = None
    held: Mapping[str, Any] = field(default_factory=dict)
    energy: Estimate | None = None
    complex_stiffness: tuple[ComplexStiffness, ...] = ()
    classes: ModelComparison | None = None
    diagnosis: Diagnosis | None = None
    tensors: Tensors | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN
    given: tuple[str, ...] = ()
    standing: Standing | None = None

    @property
    def remarks(self) -> tuple[str, ...]:
        """What a reader must know of where the figures come from, in clauses."""
        simulated = ("simulated data",) if self.origin is DataOrigin.SIMULATED else ()
        by_hand = tuple(
            f"{name} {getattr(self, name).value:.6g} {UNITS[name]} is given by hand"
            for name in self.given
            if getattr(self, name)
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

        return pd.DataFrame([self._row(name, unit) for name, unit in UNITS.items()])

    def _row(self, name: str, unit: str) -> dict[str, Any]:
        estimate: Estimate | None = getattr(self, name)
        low, high = estimate.ci95 if estimate else (np.nan, np.nan)
        return {
            "cuff": self.name,
            "donning": self.donning,
            "quantity": name,
            "unit": unit,
            "value": estimate.value if estimate else np.nan,
            "standard_error": estimate.standard_error if estimate else np.nan,
            "ci95_low": low,
            "ci95_high": high,
            "is_identified": name not in self.missing,
        }

    @property
    def verdict(self) -> str:
        """All verdicts as one text."""
        return verdict_text(self.verdicts)

    @property
    def missing(self) -> tuple[str, ...]:
        """The quantities that nobody should wear: not there, or not identified."""
        doubted = {name for verdict in self.verdicts for name in DOUBTED.get(verdict, ())}
        return tuple(name for name in QUANTITIES if getattr(self, name) is None or name in doubted)

    def parameters(self) -> CuffParameters:
        """For the solver. Raises NotIdentified if a figure is missing."""
        missing = self.missing
        if missing or self.stiffness is None or self.damping is None or self.migration is None:
            raise NotIdentified(
                f"cuff {self.name} has no {' and no '.join(missing)} to be relied on ({self.verdict}); measure it or "
                "write a value with its standard_error into cuffs.json"
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

    def to_json(self) -> str:
        """The text of cuffs.json; the same fit gives the same bytes."""
        cuffs = {
            name: {
                **_plain_cuff(fit),
                "donnings": {donning: _plain_cuff(each) for donning, each in self.donnings[name].items()},
            }
            for name, fit in self.cuffs.items()
        }
        rejected = [
            {"file": trial.file, "reason": trial.reason, "damage": list(trial.damage)} for trial in self.rejected
        ]
        plain: dict[str, Any] = {
            "origin": self.origin,
            "cuffs": cuffs,
            "rejected": rejected,
            "calibration": plain_calibration(self.calibration),
            "recordings": {file: asdict(checked) for file, checked in self.recordings.items()},
        }
        plain[SEAL] = {
            "cuffs": {name: seal_cuff(cuff, QUANTITIES) for name, cuff in cuffs.items()},
            "session": digest({key: value for key, value in plain.items() if key != "cuffs"}),
        }
        return json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def with_diagnosis(fit: CuffFit, diagnosis: Diagnosis) -> CuffFit:
    """The fit with its diagnosis; what that calls wrong, no verdict calls identified."""
    verdicts = {CauseCode.GAIN: Verdict.SCALE, CauseCode.SKIN: Verdict.SKIN}
    wrong = tuple(verdicts[cause.code] for cause in diagnosis.causes if cause.code in verdicts)
    kept = tuple(verdict for verdict in fit.verdicts if not (wrong and verdict is Verdict.IDENTIFIED))
    return replace(fit, verdicts=kept + wrong, classes=diagnosis.classes, diagnosis=diagnosis)


def covariance_of(estimates: Sequence[Estimate | None]) -> NDArray[np.float64]:
    """Diagonal covariance of independent estimates, 0 where there is none."""
    return np.diag([estimate.standard_error**2 if estimate else 0.0 for estimate in estimates])


def _plain_cuff(fit: CuffFit) -> dict[str, Any]:
    """What nobody should wear is null where a wearer looks, and told apart from it where the trials gave a figure."""
    figures = _plain_estimates(fit)
    doubtful = [QUANTITIES[name] for name in fit.missing]
    return {
        **figures,
        **dict.fromkeys(doubtful, plain_estimate(None)),
        "not_identified": {key: figures[key] for key in doubtful},
        "verdict": fit.verdict,
        "verdict_codes": list(fit.verdicts),
        "origin": fit.origin,
        "site": fit.site,
        "donning": fit.donning,
        "covariance": fit.covariance.tolist(),
        "notes": list(fit.notes),
        "diagnostics": dict(fit.diagnostics),
        "lag": _plain_lag(fit.lag),
        "static": dict(fit.held),
        "hysteresis_energy_j": plain_estimate(fit.energy),
        "complex_stiffness": plain_bands(fit.complex_stiffness),
        **_plain_tensors(fit.tensors),
        "model_class": plain_classes(fit.classes),
        "diagnosis": plain_diagnosis(fit.diagnosis),
        "sources": dict(fit.sources),
        "trials": [_plain_trial(trial) for trial in fit.trials],
    }


def _plain_tensors(tensors: Tensors | None) -> dict[str, Any]:
    if tensors is None:
        return {}
    return {
        "stiffness_tensor_n_per_m": plain_tensor(tensors.stiffness, tensors.no_stiffness),
        "damping_tensor_n_s_per_m": plain_tensor(tensors.damping, tensors.no_damping),
    }


def _plain_lag(lag: Lag | None) -> dict[str, Any]:
    if lag is None:
        return {}
    return {
        "value_s": lag.value,
        "delay_standard_error_s": lag.delay_sd,
        "edge_standard_error_s": lag.edge_sd,
        "clock_rate_standard_error": lag.drift,
        "source": lag.source,
    }


def _plain_trial(trial: TrialFit) -> dict[str, Any]:
    return {
        "file": trial.file,
        "sha256": trial.sha256,
        "test": trial.test,
        "repeat": trial.repeat,
        "run": trial.run,
        "state": trial.state,
        "reason": trial.reason,
        "notes": list(trial.notes),
        "origin": trial.origin,
        "damage": list(trial.damage),
        "sync": plain_sync(trial.sync),
        "zero_drift_n": trial.zero_drift,
        **_plain_estimates(trial),
        **({"dynamic": plain_swing(trial.swing)} if trial.swing else {}),
    }


def _plain_estimates(fit: CuffFit | TrialFit) -> dict[str, Any]:
    """Three objects of value, standard_error and ci95, each null where the trials give no figure."""
    return {key: plain_estimate(getattr(fit, name)) for name, key in QUANTITIES.items()}
