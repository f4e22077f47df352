"""Parts of a fit as plain data, for cuffs.json: units in the keys, the same fit gives the same data."""

from __future__ import annotations

from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from fitting.calibration import Calibration
from fitting.dynamic.damping import DampingFit
from fitting.dynamic.weak_form import ComplexStiffness
from fitting.laws.diagnosis import Diagnosis
from fitting.laws.model_class import ModelComparison
from fitting.timing.sync_certificate import SyncCertificate
from fitting.uncertainty import Estimate


def plain_estimate(estimate: Estimate | None) -> dict[str, Any]:
    """value, standard_error and ci95, each null where there is no estimate; parts and bound where they are known."""
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


def plain_swing(fit: DampingFit) -> dict[str, Any]:
    """What a dynamic trial says beside its damping."""
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


def plain_sync(sync: SyncCertificate | None) -> dict[str, Any] | None:
    """The trial's sync certificate; null without a sync line."""
    if sync is None:
        return None
    return {
        "has_both_edges": sync.has_both_edges,
        "offset_s": sync.offset,
        "offset_standard_error_s": sync.offset_sd,
        "clock_ratio_ppm": 1e6 * sync.drift,
        "clock_ratio_standard_error_ppm": 1e6 * sync.drift_sd,
        "clock_ratio_ci95_ppm": None if sync.drift_ci95 is None else [1e6 * end for end in sync.drift_ci95],
        "clock_ratio_is_identified": sync.is_identified,
        "stop_edge_contradiction_s": sync.contradiction,
        "peak_force_rate_n_per_s": sync.force_rate,
        "peak_speed_m_per_s": sync.speed,
        "time_standard_error_s": sync.errors.time,
        "force_standard_error_n": sync.errors.force,
        "displacement_standard_error_m": sync.errors.displacement,
        "findings": list(sync.findings),
    }


def plain_calibration(calibration: Calibration | None) -> dict[str, Any] | None:
    """The load cell by its bounce trials, and when the newest was recorded; null without one."""
    if calibration is None:
        return None
    recorded = datetime.fromtimestamp(calibration.recorded_utc_ns // 1_000_000_000, UTC)
    return {
        "lag_s": plain_estimate(calibration.lag),
        "gain": plain_estimate(calibration.gain),
        "gain_is_used": calibration.is_gain_believed,
        "zero_n": plain_estimate(calibration.zero),
        "recorded_utc": recorded.isoformat(),
        "sources": dict(calibration.sources),
        "notes": list(calibration.notes),
    }


def plain_bands(bands: Sequence[ComplexStiffness]) -> list[dict[str, Any]]:
    """K*(f) = k + i 2πf c, band by band."""
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
    """Checks D1 to D8 in order, and causes, the likeliest first."""
    if diagnosis is None:
        return None
    return {
        "findings": [
            {
                "code": each.check,
                "finding": each.code,
                "name": each.name,
                "value": each.value,
                "standard_error": each.standard_error,
                "unit": each.unit,
                "alarm": each.is_alarm,
                "figures": dict(each.more),
                "sentence": each.sentence,
            }
            for each in diagnosis.findings
        ],
        "causes": [
            {
                "cause": each.name,
                "code": each.code,
                "severity": each.severity,
                "figures": dict(each.figures),
                "finding": each.finding.code if each.finding else None,
                "sentence": each.sentence,
            }
            for each in diagnosis.causes
        ],
    }
