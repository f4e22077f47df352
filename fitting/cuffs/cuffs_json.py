"""Write a fit as the text of cuffs.json. The same fit gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from fitting.cuffs.cuff_fit import CuffFit, Lag, SessionFit
from fitting.cuffs.trial_fit import TrialFit
from fitting.cuffs.wearable_cuff import QUANTITIES
from fitting.diagnosis.causes import Diagnosis
from fitting.dynamic.damping import DampingFit
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.model_class import ModelComparison
from fitting.results.cuffs_schema import FORMAT, CuffEntry, CuffsDocument
from fitting.results.rendering import Note
from fitting.spatial.tensor import Tensor, entry_errors
from fitting.spatial.tensors import Tensors
from fitting.static.held_loads import HeldLoads
from fitting.trial.calibration import Calibration
from fitting.uncertainty import Estimate


def cuffs_json(session: SessionFit) -> str:
    """The fit as a CuffsDocument."""
    plain: dict[str, Any] = {
        "format": FORMAT,
        "origin": session.origin,
        "cuffs": {name: _written(session, name) for name in session.cuffs},
        "rejected": [
            {
                "file": trial.file,
                "reason": str(trial.reason),
                "reason_code": trial.reason.to_plain(),
                "damage": list(trial.damage),
            }
            for trial in session.rejected
        ],
        "calibration": plain_calibration(session.calibration),
        "recordings": {file: {"standing": standing} for file, standing in session.recordings.items()},
    }
    document = CuffsDocument.model_validate(plain).model_dump(mode="json", by_alias=True, exclude_unset=True)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _written(session: SessionFit, name: str) -> dict[str, Any]:
    """A cuff as last donned, and in each donning."""
    donnings = {donning: _plain_cuff(fit) for donning, fit in session.donnings[name].items()}
    entry = CuffEntry.model_validate({**_plain_cuff(session.cuffs[name]), "donnings": donnings})
    return entry.model_dump(mode="json", by_alias=True, exclude_unset=True)


def _plain_cuff(fit: CuffFit) -> dict[str, Any]:
    """A figure that is not identified is null under its key, and its value is under "not_identified"."""
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
        "notes": list(map(str, fit.notes)),
        "note_codes": [note.to_plain() for note in fit.notes],
        "diagnostics": dict(fit.diagnostics),
        **({"lag": _plain_lag(fit.lag)} if fit.lag else {}),
        **({"static": plain_held_loads(fit.held)} if fit.held and fit.held.has_loads else {}),
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


def _plain_lag(lag: Lag) -> dict[str, Any]:
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
        "test": trial.test,
        "repeat": trial.repeat,
        "run": trial.run,
        "state": trial.state,
        "reason": str(trial.reason) if trial.reason else "",
        "reason_code": trial.reason.to_plain() if trial.reason else None,
        "notes": list(map(str, trial.notes)),
        "note_codes": [note.to_plain() for note in trial.notes],
        "origin": trial.origin,
        "damage": list(trial.damage),
        "sync": None if trial.sync is None else trial.sync.to_plain(),
        "zero_drift_n": trial.zero_drift,
        **_plain_estimates(trial),
        **({"dynamic": plain_swing(trial.swing)} if trial.swing else {}),
    }


def _plain_estimates(fit: CuffFit | TrialFit) -> dict[str, Any]:
    """Stiffness, damping and migration, with null where the trials give no figure."""
    return {key: plain_estimate(getattr(fit, name)) for name, key in QUANTITIES.items()}


def plain_estimate(estimate: Estimate | None) -> dict[str, Any]:
    """value, standard_error and ci95, or null without an estimate; parts and bound if they are known."""
    if estimate is None:
        return {"value": None, "standard_error": None, "ci95": None}
    plain: dict[str, Any] = {
        "value": estimate.value,
        "standard_error": estimate.standard_error,
        "ci95": list(estimate.ci95),
    }
    if estimate.parts:
        plain["parts"] = dict(estimate.parts)
    if estimate.bound is not None:
        plain["cramer_rao_bound"] = estimate.bound
    return plain


def plain_tensor(tensor: Tensor | None, reason: Note | None) -> dict[str, Any]:
    """A tensor, or null with the reason why there is none."""
    if tensor is None:
        return {
            "value": None,
            "reason": str(reason) if reason else "",
            "reason_code": reason.to_plain() if reason else None,
        }
    return {
        "value": tensor.value.tolist(),
        "standard_error": tensor.standard_error.tolist(),
        "ci95": [end.tolist() for end in tensor.ci95],
        "parts": {cause: entry_errors(covariance).tolist() for cause, covariance in tensor.parts.items()},
        "covariance": tensor.covariance.tolist(),
        "eigenvalues": [
            {"value": eigenvalue.value, "standard_error": eigenvalue.standard_error, "ci95": list(eigenvalue.ci95)}
            for eigenvalue in tensor.eigenvalues
        ],
        "axes": tensor.axes.tolist(),
        "axes_ci95_rad": list(tensor.axis_ci95),
        "directions": tensor.directions,
    }


def plain_held_loads(held: HeldLoads) -> dict[str, Any]:
    """Results of the held loads other than the stiffness."""
    law, creep = held.stiffness.law, held.creep
    plain: dict[str, Any] = {
        "hold_s": held.hold,
        "zero_drift_n_per_s": plain_estimate(held.drift),
        "hysteresis_energy_j": plain_estimate(held.energy),
        "slip_m": held.stiffness.slip,
        "steps_s": {file: list(times) for file, times in held.steps.items()},
    }
    if creep is not None:
        plain["creep"] = {
            "is_seen": creep.is_seen,
            "fraction": plain_estimate(creep.fraction if creep.explains else None),
            "time_constant_s": creep.time_constant if creep.explains else None,
            "stiffness_at_rest_n_per_m": plain_estimate(creep.stiffness_at_rest if creep.explains else None),
        }
    if law is not None:
        plain["exponential_law"] = {
            "stiffening_per_m": plain_estimate(law.stiffening),
            "tangents": [{"force_n": load, "stiffness_n_per_m": plain_estimate(k)} for load, k in held.tangents],
        }
    return plain


def plain_swing(fit: DampingFit) -> dict[str, Any]:
    """Results of a dynamic trial other than its damping."""
    return {
        "method": fit.method,
        "outcome": fit.outcome,
        "frequency_hz": fit.oscillation.frequency,
        "force_amplitude_n": fit.oscillation.amplitude,
        "dynamic_stiffness_n_per_m": plain_estimate(fit.stiffness),
        "hysteresis_energy_j": plain_estimate(fit.energy),
        "lag_s": fit.lag,
        "force_noise_n": fit.force_noise,
        "marker_noise_m": fit.marker_noise,
        "marker_noise_correlation": fit.checks.marker_correlation,
        "residual_at_harmonics_n": list(fit.checks.harmonics),
        "residual_between_harmonics_n": fit.checks.harmonic_noise,
        "cross_checks": [
            {
                "method": other.method,
                "stiffness_n_per_m": plain_estimate(other.stiffness),
                "damping_n_s_per_m": plain_estimate(other.damping),
            }
            for other in fit.checks.others
        ],
        "complex_stiffness": plain_bands(fit.checks.complex_stiffness),
    }


def plain_calibration(calibration: Calibration | None) -> dict[str, Any] | None:
    """Calibration of the load cell by bounce trials, and when the newest was recorded; null without one."""
    if calibration is None:
        return None
    recorded = datetime.fromtimestamp(calibration.recorded_utc_ns // 1_000_000_000, UTC)
    return {
        "lag_s": plain_estimate(calibration.lag),
        "gain": plain_estimate(calibration.gain),
        "gain_is_used": calibration.is_gain_used,
        "zero_n": plain_estimate(calibration.zero),
        "recorded_utc": recorded.isoformat(),
        "sources": dict(calibration.sources),
        "notes": list(map(str, calibration.notes)),
        "note_codes": [note.to_plain() for note in calibration.notes],
    }


def plain_bands(bands: Sequence[ComplexStiffness]) -> list[dict[str, Any]]:
    """K*(f) = k + i 2πf c in bands of frequency."""
    return [
        {
            "frequency_hz": band.frequency,
            "stiffness_n_per_m": plain_estimate(band.stiffness),
            "damping_n_s_per_m": plain_estimate(band.damping),
        }
        for band in bands
    ]


def plain_classes(classes: ModelComparison | None) -> dict[str, Any] | None:
    """The chosen law and the ranking, best first."""
    if classes is None:
        return None
    return {
        "chosen": classes.name,
        "extensions": list(classes.chosen),
        "ranking": [
            {"class": score.name, "left_over_n": score.residual_rms, "gain": score.gain} for score in classes.ranking
        ],
    }


def plain_diagnosis(diagnosis: Diagnosis | None) -> dict[str, Any] | None:
    """Checks D1 to D8 in order, and causes, most severe first."""
    if diagnosis is None:
        return None
    return {
        "findings": [
            {
                "code": finding.check,
                "finding": finding.code,
                "name": finding.name,
                "value": finding.value,
                "standard_error": finding.standard_error,
                "unit": finding.unit,
                "alarm": finding.is_alarm,
                "figures": dict(finding.more),
                "sentence": finding.sentence,
            }
            for finding in diagnosis.findings
        ],
        "causes": [
            {
                "cause": cause.name,
                "code": cause.code,
                "severity": cause.severity,
                "figures": dict(cause.figures),
                "finding": cause.finding.code if cause.finding else None,
                "sentence": cause.sentence,
            }
            for cause in diagnosis.causes
        ],
    }
