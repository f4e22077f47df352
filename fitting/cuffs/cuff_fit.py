"""Result of a fit: estimates, verdicts and provenance of a recording, of a cuff, and of all cuffs of a session."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import combinations
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from documents.interval import between, with_error
from documents.results import Curve, EqualByFields
from fitting.cuffs.wearable_cuff import QUANTITIES, TENSOR, UNITS, Cuff, cuff_html
from fitting.diagnosis.causes import Diagnosis
from fitting.diagnosis.identification import FittedPull
from fitting.dynamic.cross_checks import ComplexStiffness
from fitting.dynamic.damping import DampingFit
from fitting.laws.model_class import ModelComparison
from fitting.pull.pull import Pull
from fitting.results.codes import EXPLAINED_BY, Standing, Verdict
from fitting.results.sentences import Note, verdict_text
from fitting.results.trial_codes import RejectionCode, TrialNoteCode
from fitting.spatial.tensors import Tensors
from fitting.static.held_loads import HeldLoads, fit_migration
from fitting.static.stiffness import trial_stiffness
from fitting.trial.calibration import Calibration
from fitting.trial.timeline import SyncCertificate, damage_figures
from fitting.trial.trial import RejectedTrial, Trial
from fitting.uncertainty import Estimate
from recordings.manifest import DataOrigin
from solver.cuff import CuffParameters

if TYPE_CHECKING:
    import pandas as pd

State = Literal["used", "superseded", "unusable"]


@dataclass(frozen=True, eq=False)
class TrialFit(EqualByFields):
    """The use of one recording in a fit: "used", "superseded" by a later run, or "unusable" with the reason.

    The estimates are from this trial alone, None if it does not determine them; swing is the fit of a dynamic trial.
    sync        certificate of the sync line, None without one
    origin      measured or simulated, as the devices report
    zero_drift  [N] change of the force at rest from start to end, None if the trial does not rest at both
    damage      of the file, beyond a cut end; then the trial has no other notes
    """

    file: str
    test: str
    repeat: int
    run: int
    state: State
    reason: Note | None = None
    notes: tuple[Note, ...] = ()
    stiffness: Estimate | None = None
    damping: Estimate | None = None
    migration: Estimate | None = None
    swing: DampingFit | None = None
    sync: SyncCertificate | None = None
    zero_drift: float | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN
    damage: tuple[str, ...] = ()

    def __repr__(self) -> str:
        found = {name: (getattr(self, name), unit) for name, unit in CuffParameters.UNITS.items()}
        values = [
            f"{name} {with_error(one.value, one.standard_error)} {unit}" for name, (one, unit) in found.items() if one
        ]
        return f"TrialFit {self.file}: {', '.join([self.state, *values])}" + (
            f"; {self.reason.code}" if self.reason else ""
        )


def list_trials(
    trials: Sequence[Trial],
    pulls: Sequence[Pull],
    used: Mapping[str, Pull],
    fitted: Mapping[str, FittedPull],
    if_friction: Estimate | None,
    refused: Mapping[str, Note],
) -> tuple[TrialFit, ...]:
    """Every recording of a donning with its use in the fit; used, fitted and refused are by file."""
    numbers = {pull.trial.file: pull.direction_number for pull in pulls}
    counting = {(pull.trial.test, pull.trial.repeat, pull.direction_number): file for file, pull in used.items()}
    listed = []
    for trial in trials:
        again = counting.get((trial.test, trial.repeat, numbers.get(trial.file, 0)), trial.file)
        superseded = None if trial.file in used else Note(RejectionCode.RECORDED_AGAIN, {"file": again})
        reason = refused.get(trial.file, superseded)
        state: State = "used" if trial.file in used else "unusable" if trial.file in refused else "superseded"
        fit = TrialFit(
            file=trial.file,
            test=trial.test,
            repeat=trial.repeat,
            run=trial.run,
            state=state,
            reason=reason,
            notes=trial.notes,
            sync=trial.sync,
            zero_drift=trial.zero_drift,
            origin=trial.origin,
        )
        if trial.file in used:
            fit = _with_estimates(fit, used[trial.file], fitted.get(trial.file), if_friction)
        listed.append(_with_damage(fit, trial.damage) if trial.damage else fit)
    return tuple(listed)


def _with_estimates(fit: TrialFit, pull: Pull, fitted: FittedPull | None, if_friction: Estimate | None) -> TrialFit:
    """Add the estimates from this trial alone, and the notes on them."""
    static, swing = (fitted.static, fitted.dynamic) if fitted else (None, None)
    return replace(
        fit,
        notes=pull.notes
        + (swing.notes if swing else ())
        + ((Note(TrialNoteCode.ONE_BRANCH),) if if_friction and static else ()),
        stiffness=trial_stiffness(static, if_friction) if static else None,
        damping=swing.damping.estimate if swing else None,
        swing=swing,
        migration=fit_migration([pull.plateaus]),
    )


def _with_damage(fit: TrialFit, damage: tuple[str, ...]) -> TrialFit:
    """Replace the notes on a damaged file by its damage."""
    figures = damage_figures(damage)
    reason = fit.reason and Note(RejectionCode.DAMAGED, figures)
    return replace(fit, notes=(Note(TrialNoteCode.DAMAGED, figures),), reason=reason, damage=damage)


COMPARED: tuple[Literal["stiffness", "damping"], ...] = ("stiffness", "damping")
OUTLYING = 3.0
"""Combined standard errors from which a repeat differs from the others."""
SLIPPED = 0.025
"""Metres of migration in one trial; published cuffs migrated by at most 22 mm in a session."""
LEAST_ERROR = 1e-12


@dataclass(frozen=True)
class Outlier:
    """A quantity of one repeat [SI], the mean of the other repeats, and their distance in combined standard errors."""

    quantity: Literal["stiffness", "damping"]
    value: float
    mean: float
    distance: float


def find_outliers(trial: TrialFit, others: Sequence[TrialFit]) -> tuple[Outlier, ...]:
    """Stiffness and damping of a trial that differ from those of the other repeats of the donning."""
    found = []
    for quantity in COMPARED:
        this = getattr(trial, quantity)
        rest = [estimate for other in others if (estimate := getattr(other, quantity)) is not None]
        if this is None or not rest:
            continue
        mean, error = _pooled(rest)
        distance = abs(this.value - mean) / max(math.hypot(this.standard_error, error), LEAST_ERROR)
        if distance > OUTLYING:
            found.append(Outlier(quantity, this.value, mean, distance))
    return tuple(found)


def has_slipped(trial: TrialFit) -> bool:
    """Whether the cuff migrated by more than SLIPPED in this trial."""
    return trial.migration is not None and trial.migration.value > SLIPPED


def _pooled(estimates: Sequence[Estimate]) -> tuple[float, float]:
    """Mean of some estimates and its standard error, from their spread or their own errors, whichever is larger."""
    values = np.array([estimate.value for estimate in estimates])
    own = float(np.sqrt(np.mean([estimate.standard_error**2 for estimate in estimates])))
    spread = float(values.std(ddof=1)) if len(values) > 1 else 0.0
    return float(values.mean()), max(own, spread)


@dataclass(frozen=True)
class Lag:
    """Lag of force against markers [s], already removed from the times of the force, and its standard uncertainties.

    delay_sd   common to all trials;  edge_sd  independent in every trial;  drift  [s/s] of the ratio of the clocks
    source     "declared", or the files of the bounce trials that calibrated it
    """

    value: float
    delay_sd: float
    edge_sd: float
    drift: float
    source: str


@dataclass(frozen=True, eq=False, repr=False)
class CuffFit(EqualByFields):
    """k [N/m], c [N s/m] and migration [m] of a cuff in one donning, None if the trials give no figure.

    The verdicts name what is not identified. Such a figure is given with its interval and listed in `missing`.

    covariance  (3, 3) of (stiffness, damping, migration); zero where one is None
    sources     file → SHA-256 of every recording that was used
    trials      every recording of the donning
    notes       remarks;  diagnostics  numbers in SI with the unit in the key
    lag         of force against markers
    held        results of the held loads: drift, creep, tangent stiffness, energy
    energy      J dissipated in a cycle of the dynamic trials
    complex_stiffness  K* in bands of frequency from all dynamic trials
    classes     comparison of constitutive laws;  diagnosis  checks D1 to D8 and causes
    origin      of the recordings that were used: simulated if any of them is
    tensors     K and C in three dimensions, or why there are none
    pulls       file → pull and its fits, of every trial that was used: the arrays behind the figures
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
    held: HeldLoads | None = None
    energy: Estimate | None = None
    complex_stiffness: tuple[ComplexStiffness, ...] = ()
    classes: ModelComparison | None = None
    diagnosis: Diagnosis | None = None
    tensors: Tensors | None = None
    origin: DataOrigin = DataOrigin.UNKNOWN
    pulls: Mapping[str, FittedPull] = field(default_factory=dict)

    def wearable(self) -> Cuff:
        """The cuff for use in a suit."""
        tensors = self.tensors and (self.tensors.stiffness or self.tensors.damping)
        return Cuff(
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
            causes=tuple(note for note in self.notes if note.code in EXPLAINED_BY),
        )

    def parameters(self) -> CuffParameters:
        """For the solver. Raises NotIdentified if a figure is missing."""
        return self.wearable().parameters()

    def __repr__(self) -> str:
        codes = ", ".join(dict.fromkeys(note.code for note in self.notes))
        return repr(self.wearable()) + (f"\nnotes: {codes}" if codes else "")

    def _repr_html_(self) -> str:
        return cuff_html({self.name: self.wearable()}, _curves(self.pulls))

    def report(self) -> str:
        """Trials, estimates, their standard errors by cause, correlations and notes as text, as lmfit's fit_report."""
        return _report(self)

    def to_dataframe(self) -> pd.DataFrame:
        """A row per quantity, with its unit, value, standard_error, ci95_low, ci95_high and is_identified."""
        return self.wearable().to_dataframe()

    def covariance_dataframe(self) -> pd.DataFrame:
        """The covariance with the names of the quantities as rows and columns, in the units of attrs["units"]."""
        return self.wearable().covariance_dataframe()

    def trials_dataframe(self) -> pd.DataFrame:
        """A row per recording: file, test, repeat, run, state, and the estimates from this trial alone with their
        standard errors, NaN if it does not determine them.
        """
        import pandas as pd

        table = pd.DataFrame([_trial_row(trial) for trial in self.trials])
        table.attrs["units"] = {
            column: unit for name, unit in UNITS.items() for column in (name, f"{name}_standard_error")
        } | {"zero_drift": "N"}
        return table

    @property
    def verdict(self) -> str:
        """All verdicts as one text."""
        return verdict_text(self.verdicts, self.notes)

    @property
    def missing(self) -> tuple[str, ...]:
        """Quantities that are absent or not identified, and so must not be used."""
        doubted = {name for verdict in self.verdicts for name in verdict.quantities}
        return tuple(name for name in QUANTITIES if getattr(self, name) is None or name in doubted)


@dataclass(frozen=True, eq=False, repr=False)
class SessionFit(EqualByFields):
    """All cuffs of a session.

    donnings  cuff → donning → fit, donnings in the order they were recorded
    rejected  recordings that could not be read as trials
    calibration  of the load cell by the session's bounce trials, None without one
    recordings   file → its comparison with the recorded hash; also of recordings that were set aside
    """

    donnings: Mapping[str, Mapping[str, CuffFit]]
    rejected: tuple[RejectedTrial, ...]
    calibration: Calibration | None = None
    recordings: Mapping[str, Standing] = field(default_factory=dict)

    @property
    def bounces(self) -> tuple[str, ...]:
        """Files of the bounce trials that calibrate lag and gain; empty if these are as declared."""
        return tuple(self.calibration.sources) if self.calibration else ()

    @property
    def cuffs(self) -> dict[str, CuffFit]:
        """Every cuff in its last donning."""
        return {name: list(fits.values())[-1] for name, fits in self.donnings.items()}

    def __repr__(self) -> str:
        lines = [f"Session: cuffs {', '.join(self.donnings) or 'none'}; recordings not used: {len(self.rejected)}"]
        return "\n".join([*lines, *map(repr, self.cuffs.values())])

    def to_dataframe(self) -> pd.DataFrame:
        """CuffFit.to_dataframe of every donning of every cuff."""
        import pandas as pd

        tables = [fit.to_dataframe() for fits in self.donnings.values() for fit in fits.values()]
        return pd.concat(tables, ignore_index=True) if tables else pd.DataFrame()

    def _repr_html_(self) -> str:
        return cuff_html({name: fit.wearable() for name, fit in self.cuffs.items()}, _curves(self.pulls))

    @property
    def pulls(self) -> dict[str, FittedPull]:
        """File → pull and its fits, of every trial that was used."""
        fits = [fit for donnings in self.donnings.values() for fit in donnings.values()]
        return {file: pull for fit in fits for file, pull in fit.pulls.items()}

    def with_notes(self, notes: tuple[Note, ...]) -> SessionFit:
        """The fit with these notes added to every cuff."""
        donnings = {
            name: {donning: replace(fit, notes=fit.notes + notes) for donning, fit in fits.items()}
            for name, fits in self.donnings.items()
        }
        return replace(self, donnings=donnings)

    @property
    def origin(self) -> DataOrigin:
        """Simulated if any cuff's is."""
        return DataOrigin.joined(fit.origin for fits in self.donnings.values() for fit in fits.values())

    @property
    def damage(self) -> dict[str, tuple[str, ...]]:
        """File → damage, of every damaged recording."""
        fits = [fit for donnings in self.donnings.values() for fit in donnings.values()]
        found = {trial.file: trial.damage for trial in self.rejected}
        found |= {trial.file: trial.damage for fit in fits for trial in fit.trials}
        return {file: damage for file, damage in found.items() if damage}


def _curves(pulls: Mapping[str, FittedPull]) -> dict[str, Curve]:
    """File → displacement [mm] and force [N]."""
    tables = {file: fitted.pull.to_dataframe() for file, fitted in pulls.items()}
    return {file: (1e3 * table["displacement"].to_numpy(), table["force"].to_numpy()) for file, table in tables.items()}


def _trial_row(trial: TrialFit) -> dict[str, object]:
    row: dict[str, object] = {name: getattr(trial, name) for name in ("file", "test", "repeat", "run", "state")}
    for name in QUANTITIES:
        estimate = getattr(trial, name)
        row[name] = np.nan if estimate is None else estimate.value
        row[f"{name}_standard_error"] = np.nan if estimate is None else estimate.standard_error
    drift = np.nan if trial.zero_drift is None else trial.zero_drift
    return row | {"zero_drift": drift, "reason": str(trial.reason or "")}


def _report(fit: CuffFit) -> str:
    """Trials, estimates with standard errors, their causes and their correlations; a note per line at the end."""
    used = [trial for trial in fit.trials if trial.state == "used"]
    lines = [
        "[[Cuff]]",
        f"    {fit.name} ({fit.site}), donning {fit.donning}: {fit.verdict}",
        "[[Trials]]",
        *(f"    {trial.file}: {trial.state}" for trial in fit.trials),
        f"    # used = {len(used)} of {len(fit.trials)}",
        "[[Estimates]]",
        *(_estimate_line(fit, name) for name in QUANTITIES),
        "[[Standard error by cause]]",
        *(_parts_line(fit, name) for name in QUANTITIES if getattr(fit, name)),
        "[[Correlations]]",
        *_correlation_lines(fit),
        *(["[[Notes]]"] if fit.notes else []),
        *(f"    {note.code}: {note}" for note in fit.notes),
    ]
    return "\n".join(lines)


def _estimate_line(fit: CuffFit, name: str) -> str:
    estimate = getattr(fit, name)
    if estimate is None:
        return f"    {name + ':':11} not identified"
    text = with_error(estimate.value, estimate.standard_error).replace("±", "+/-")
    relative = 100 * estimate.standard_error / abs(estimate.value) if estimate.value else np.inf
    standing = "" if name not in fit.missing else ", not identified"
    return f"    {name + ':':11} {text} {UNITS[name]} ({relative:.2g} %), 95 %: {between(estimate.ci95)}{standing}"


def _parts_line(fit: CuffFit, name: str) -> str:
    parts = sorted(getattr(fit, name).parts.items(), key=lambda part: -part[1])
    return f"    {name + ':':11} " + ", ".join(f"{cause} {error:.2g}" for cause, error in parts if error > 0)


def _correlation_lines(fit: CuffFit) -> list[str]:
    errors = np.sqrt(np.diag(fit.covariance))
    return [
        f"    C({first}, {second}) = {fit.covariance[i, j] / (errors[i] * errors[j]):+.3f}"
        for (i, first), (j, second) in combinations(enumerate(QUANTITIES), 2)
        if errors[i] > 0 and errors[j] > 0
    ]


def estimate_lag(trials: Sequence[Trial]) -> Lag:
    """The lag used for the trials of a donning, its source and its uncertainty."""
    lag = trials[0].lag
    edge = max(trial.lag.edge for trial in trials)
    return Lag(lag.value, lag.declared, edge, max(trial.lag.drift for trial in trials), lag.source)
