"""Read and write cuffs.json, as a fit wrote it or with values given by hand. The same fit gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Collection, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from documents.message import Figures
from documents.plain_data import PlainDataError, read_json, shortened
from documents.regular_file import ensure_path, replaced
from documents.validation import describe_error, faulty_key
from fitting.cuffs.cuff_fit import CuffFit, Lag, SessionFit, TrialFit
from fitting.cuffs.wearable_cuff import KNOWN_LAW, QUANTITIES, TENSOR, Cuff, joint_covariance
from fitting.diagnosis.causes import Diagnosis
from fitting.dynamic.cross_checks import ComplexStiffness
from fitting.dynamic.damping import DampingFit
from fitting.errors import CodedError
from fitting.laws.model_class import KELVIN_VOIGT, ModelComparison
from fitting.results import cuffs_schema
from fitting.results.codes import EXPLAINED_BY, FitErrorCode, Verdict
from fitting.results.cuffs_schema import FORMAT, CuffEntry, CuffsDocument, FigureEntry
from fitting.results.sentences import Note
from fitting.spatial.tensors import Tensor, entry_errors
from fitting.static.held_loads import Creep, HeldLoads
from fitting.trial.calibration import Calibration
from fitting.trial.timeline import SyncCertificate
from fitting.uncertainty import NORMAL_95, Estimate
from recordings.manifest import is_file_name


def cuffs_json(session: SessionFit) -> str:
    """The fit as the text of cuffs.json."""
    plain = cuffs_document(session).model_dump(mode="json", by_alias=True, exclude_unset=True)
    return json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def cuffs_document(session: SessionFit) -> CuffsDocument:
    """The content of cuffs.json."""
    return CuffsDocument(
        format=FORMAT,
        origin=session.origin,
        cuffs={
            name: _cuff_entry(fit, donnings={key: _cuff_entry(one) for key, one in session.donnings[name].items()})
            for name, fit in session.cuffs.items()
        },
        rejected=[
            cuffs_schema.RejectedEntry(
                file=trial.file,
                reason=str(trial.reason),
                reason_code=cuffs_schema.ReasonEntry.model_validate(trial.reason),
                damage=list(trial.damage),
            )
            for trial in session.rejected
        ],
        calibration=_calibration_entry(session.calibration) if session.calibration else None,
        recordings={
            file: cuffs_schema.RecordingEntry(standing=standing) for file, standing in session.recordings.items()
        },
    )


def _known(**optional: Any) -> dict[str, Any]:
    """The keys with a value; the others are left out of the file."""
    return {key: value for key, value in optional.items() if value is not None}


def _cuff_entry(fit: CuffFit, donnings: Mapping[str, CuffEntry] | None = None) -> CuffEntry:
    """A figure that is not identified is null under its key, and its value is under "not_identified"."""
    figures = _figures(fit)
    doubtful = [QUANTITIES[name] for name in fit.missing]
    held, tensors = fit.held, fit.tensors
    return CuffEntry(
        **_known(**figures | dict.fromkeys(doubtful, figure_entry(None))),
        not_identified={key: figures[key] for key in doubtful},
        verdict=fit.verdict,
        verdict_codes=list(fit.verdicts),
        origin=fit.origin,
        site=fit.site,
        donning=fit.donning,
        covariance=fit.covariance.tolist(),
        notes=list(map(str, fit.notes)),
        note_codes=list(map(cuffs_schema.NoteEntry.model_validate, fit.notes)),
        diagnostics=dict(fit.diagnostics),
        **_known(
            lag=_lag_entry(fit.lag) if fit.lag else None,
            static=held_loads_entry(held) if held and held.has_loads else None,
            stiffness_tensor_n_per_m=_tensor_entry(tensors.stiffness, tensors.no_stiffness) if tensors else None,
            damping_tensor_n_s_per_m=_tensor_entry(tensors.damping, tensors.no_damping) if tensors else None,
            donnings=donnings,
        ),
        hysteresis_energy_j=figure_entry(fit.energy),
        complex_stiffness=list(map(_band_entry, fit.complex_stiffness)),
        model_class=_class_entry(fit.classes) if fit.classes else None,
        diagnosis=_diagnosis_entry(fit.diagnosis) if fit.diagnosis else None,
        sources=dict(fit.sources),
        trials=list(map(_trial_entry, fit.trials)),
    )


def _lag_entry(lag: Lag) -> cuffs_schema.LagEntry:
    return cuffs_schema.LagEntry(
        value_s=lag.value,
        delay_standard_error_s=lag.delay_sd,
        edge_standard_error_s=lag.edge_sd,
        clock_rate_standard_error=lag.drift,
        source=lag.source,
    )


def _trial_entry(trial: TrialFit) -> cuffs_schema.TrialEntry:
    return cuffs_schema.TrialEntry(
        file=trial.file,
        test=trial.test,
        repeat=trial.repeat,
        run=trial.run,
        state=trial.state,
        reason=str(trial.reason or ""),
        reason_code=cuffs_schema.ReasonEntry.model_validate(trial.reason) if trial.reason else None,
        notes=list(map(str, trial.notes)),
        note_codes=list(map(cuffs_schema.TrialNoteEntry.model_validate, trial.notes)),
        origin=trial.origin,
        damage=list(trial.damage),
        sync=sync_entry(trial.sync) if trial.sync else None,
        zero_drift_n=trial.zero_drift,
        **_known(**_figures(trial), dynamic=_swing_entry(trial.swing) if trial.swing else None),
    )


def sync_entry(certificate: SyncCertificate) -> cuffs_schema.SyncEntry:
    """The sync certificate of a trial."""
    ends = certificate.drift_ci95
    return cuffs_schema.SyncEntry(
        has_both_edges=certificate.has_both_edges,
        offset_s=certificate.offset,
        offset_standard_error_s=certificate.offset_sd,
        clock_ratio_ppm=1e6 * certificate.drift,
        clock_ratio_standard_error_ppm=1e6 * certificate.drift_sd,
        clock_ratio_ci95_ppm=None if ends is None else [1e6 * end for end in ends],
        clock_ratio_is_identified=certificate.is_identified,
        stop_edge_contradiction_s=certificate.contradiction,
        peak_force_rate_n_per_s=certificate.force_rate,
        peak_speed_m_per_s=certificate.speed,
        time_standard_error_s=certificate.errors.time,
        force_standard_error_n=certificate.errors.force,
        displacement_standard_error_m=certificate.errors.displacement,
        findings=list(map(str, certificate.findings)),
        finding_codes=list(map(cuffs_schema.TrialNoteEntry.model_validate, certificate.findings)),
    )


def _figures(fit: CuffFit | TrialFit) -> dict[str, FigureEntry]:
    """Stiffness, damping and migration, with null where the trials give no figure."""
    return {key: figure_entry(getattr(fit, name)) for name, key in QUANTITIES.items()}


def figure_entry(estimate: Estimate | None) -> FigureEntry:
    """value, standard_error and ci95, or null without an estimate; parts and bound if they are known."""
    if estimate is None:
        return FigureEntry(value=None, standard_error=None, ci95=None)
    return FigureEntry(
        value=estimate.value,
        standard_error=estimate.standard_error,
        ci95=list(estimate.ci95),
        **_known(parts=dict(estimate.parts) or None, cramer_rao_bound=estimate.bound),
    )


def _tensor_entry(tensor: Tensor | None, reason: Note | None) -> cuffs_schema.TensorEntry:
    """A tensor, or null with the reason why there is none."""
    if tensor is None:
        code = cuffs_schema.TensorReasonEntry.model_validate(reason) if reason else None
        return cuffs_schema.TensorEntry(value=None, reason=str(reason or ""), reason_code=code)
    return cuffs_schema.TensorEntry(
        value=tensor.value.tolist(),
        standard_error=tensor.standard_error.tolist(),
        ci95=[end.tolist() for end in tensor.ci95],
        parts={cause: entry_errors(covariance).tolist() for cause, covariance in tensor.parts.items()},
        covariance=tensor.covariance.tolist(),
        eigenvalues=list(map(figure_entry, tensor.eigenvalues)),
        axes=tensor.axes.tolist(),
        axes_ci95_rad=list(tensor.axis_ci95),
        directions=tensor.directions,
    )


def held_loads_entry(held: HeldLoads) -> cuffs_schema.HeldLoadsEntry:
    """Results of the held loads other than the stiffness."""
    law = held.stiffness.law
    return cuffs_schema.HeldLoadsEntry(
        hold_s=held.hold,
        zero_drift_n_per_s=figure_entry(held.drift),
        hysteresis_energy_j=figure_entry(held.energy),
        slip_m=held.stiffness.slip,
        steps_s={file: list(times) for file, times in held.steps.items()},
        **_known(
            creep=_creep_entry(held.creep) if held.creep else None,
            exponential_law=law
            and cuffs_schema.ExponentialLawEntry(
                stiffening_per_m=figure_entry(law.stiffening),
                tangents=[
                    cuffs_schema.TangentEntry(force_n=load, stiffness_n_per_m=figure_entry(k))
                    for load, k in held.tangents
                ],
            ),
        ),
    )


def _creep_entry(creep: Creep) -> cuffs_schema.CreepEntry:
    return cuffs_schema.CreepEntry(
        is_seen=creep.is_seen,
        fraction=figure_entry(creep.fraction if creep.explains else None),
        time_constant_s=creep.time_constant if creep.explains else None,
        stiffness_at_rest_n_per_m=figure_entry(creep.stiffness_at_rest if creep.explains else None),
    )


def _swing_entry(fit: DampingFit) -> cuffs_schema.SwingEntry:
    """Results of a dynamic trial other than its damping."""
    return cuffs_schema.SwingEntry(
        method=fit.method,
        outcome=fit.outcome,
        frequency_hz=fit.oscillation.frequency,
        force_amplitude_n=fit.oscillation.amplitude,
        dynamic_stiffness_n_per_m=figure_entry(fit.stiffness),
        hysteresis_energy_j=figure_entry(fit.energy),
        lag_s=fit.lag,
        force_noise_n=fit.force_noise,
        marker_noise_m=fit.marker_noise,
        marker_noise_correlation=fit.checks.marker_correlation,
        residual_at_harmonics_n=list(fit.checks.harmonics),
        residual_between_harmonics_n=fit.checks.harmonic_noise,
        cross_checks=[
            cuffs_schema.CrossCheckEntry(
                method=other.method,
                stiffness_n_per_m=figure_entry(other.stiffness),
                damping_n_s_per_m=figure_entry(other.damping),
            )
            for other in fit.checks.others
        ],
        complex_stiffness=list(map(_band_entry, fit.checks.complex_stiffness)),
    )


def _calibration_entry(calibration: Calibration) -> cuffs_schema.CalibrationEntry:
    """Calibration of the load cell by bounce trials, and when the newest was recorded."""
    recorded = datetime.fromtimestamp(calibration.recorded_utc_ns // 1_000_000_000, UTC)
    return cuffs_schema.CalibrationEntry(
        lag_s=figure_entry(calibration.lag),
        gain=figure_entry(calibration.gain),
        gain_is_used=calibration.is_gain_used,
        zero_n=figure_entry(calibration.zero),
        recorded_utc=recorded.isoformat(),
        sources=dict(calibration.sources),
        notes=list(map(str, calibration.notes)),
        note_codes=list(map(cuffs_schema.TrialNoteEntry.model_validate, calibration.notes)),
    )


def _band_entry(band: ComplexStiffness) -> cuffs_schema.BandEntry:
    """K*(f) = k + i 2πf c in a band of frequency."""
    return cuffs_schema.BandEntry(
        frequency_hz=band.frequency,
        stiffness_n_per_m=figure_entry(band.stiffness),
        damping_n_s_per_m=figure_entry(band.damping),
    )


def _class_entry(classes: ModelComparison) -> cuffs_schema.ModelClassEntry:
    """The chosen law and the ranking, best first."""
    ranking = [
        cuffs_schema.ClassEntry.model_validate(
            {"class": score.name, "left_over_n": score.residual_rms, "gain": score.gain}
        )
        for score in classes.ranking
    ]
    return cuffs_schema.ModelClassEntry(chosen=classes.name, extensions=list(classes.chosen), ranking=ranking)


def _diagnosis_entry(diagnosis: Diagnosis) -> cuffs_schema.DiagnosisEntry:
    """Checks D1 to D8 in order, and causes, most severe first."""
    findings = [
        cuffs_schema.FindingEntry(
            code=finding.check,
            finding=finding.code,
            name=finding.name,
            value=finding.value,
            standard_error=finding.standard_error,
            unit=finding.unit,
            alarm=finding.is_alarm,
            figures=dict(finding.more),
            sentence=finding.sentence,
        )
        for finding in diagnosis.findings
    ]
    causes = [
        cuffs_schema.CauseEntry(
            cause=cause.name,
            code=cause.code,
            severity=cause.severity,
            figures=dict(cause.figures),
            finding=cause.finding.code if cause.finding else None,
            sentence=cause.sentence,
        )
        for cause in diagnosis.causes
    ]
    return cuffs_schema.DiagnosisEntry(findings=findings, causes=causes)


CUFFS_FILE = "cuffs.json"
"""Its name in a session folder."""
FIGURE_KEYS = ("value", "standard_error", "ci95")
"""Of a figure that is written by hand."""


class CuffsFileError(CodedError):
    """A cuffs.json that cannot be used."""


def read_cuffs(path: Path | str) -> dict[str, Cuff]:
    """Read the cuffs of a cuffs.json by name, also of one written by hand. Raises CuffsFileError."""
    return wearable_cuffs(read_cuffs_document(ensure_path("path", path)))


def wearable_cuffs(document: CuffsDocument) -> dict[str, Cuff]:
    """The cuffs of a document by name."""
    return {name: _wearable(name, entry) for name, entry in document.cuffs.items()}


def read_cuffs_document(path: Path) -> CuffsDocument:
    """Read a cuffs.json with its donnings and trials. Raises CuffsFileError."""
    return _validated(path, _read_document(path))


def write_cuffs(path: Path | str, cuffs: Mapping[str, CuffFit]) -> None:
    """Write cuffs by name, for read_cuffs and `station assess`. An existing file is replaced atomically.

    Trials, tensors and the diagnosis are written, but read_cuffs does not read them. Raises OSError, which names the
    path, and TypeError for anything but fits by name.
    """
    ensure_by_name(cuffs)
    if others := [type(fit).__name__ for fit in cuffs.values() if not isinstance(fit, CuffFit)]:
        raise TypeError(f"cuffs should be results of a fit, and one is a {others[0]}; copy the file it was read from")
    text = cuffs_json(SessionFit({name: {fit.donning: fit} for name, fit in cuffs.items()}, ()))
    with replaced(ensure_path("path", path), with_folder=False) as draft:
        draft.write_text(text, encoding="utf-8")


def ensure_by_name(cuffs: object) -> None:
    """Raise TypeError for anything but a mapping, as a session or a list of cuffs."""
    if not isinstance(cuffs, Mapping):
        found = type(cuffs).__name__
        raise TypeError(f"cuffs should be a mapping from names to cuffs, as fit_session(…).cuffs is, and got a {found}")


def _read_document(path: Path) -> dict[str, Any]:
    """The file as plain data, of a known format."""
    try:
        data = read_json(path)
    except OSError as error:
        figures: Figures = {"file": str(path), "problem": error.strerror or str(error)}
        raise CuffsFileError(FitErrorCode.CUFFS_UNREADABLE, figures) from error
    except PlainDataError as error:
        figures = {"file": str(path), "problem": str(error)}
        raise CuffsFileError(FitErrorCode.CUFFS_NOT_JSON, figures) from error
    if not (isinstance(data, dict) and isinstance(data.get("cuffs"), dict)):
        raise CuffsFileError(FitErrorCode.CUFFS_MISSING, {"file": str(path)})
    if data.get("format", FORMAT) != FORMAT:
        figures = {"file": str(path), "found": shortened(data["format"]), "expected": FORMAT}
        raise CuffsFileError(FitErrorCode.CUFFS_FORMAT, figures)
    return data


def _validated(path: Path, data: Mapping[str, Any]) -> CuffsDocument:
    if unnamed := [name for name in data["cuffs"] if not is_file_name(name)]:
        named: Figures = {"file": str(path), "cuff": shortened(unnamed[0])}
        raise CuffsFileError(FitErrorCode.CUFFS_NAME, named)
    try:
        document = CuffsDocument.model_validate({"format": FORMAT, **data})
    except ValidationError as error:
        fault: Figures = {"file": str(path), "key": faulty_key(error), "problem": describe_error(error)}
        raise CuffsFileError(FitErrorCode.CUFFS_INVALID, fault) from error
    if "recordings" not in data:
        _ensure_known_keys(path, data["cuffs"])
    return document


def _ensure_known_keys(path: Path, cuffs: Mapping[str, Any]) -> None:
    """Raise CuffsFileError for an unknown key of a cuff that no station wrote; later stations may add keys."""
    for name, entry in cuffs.items():
        quantities, doubtful = tuple(QUANTITIES.values()), entry.get("not_identified") or {}
        tables: list[tuple[str, Any, Collection[str], tuple[str, ...]]]
        tables = [
            (f"cuffs.{name}", entry, CuffEntry.model_fields, quantities),
            (f"cuffs.{name}.not_identified", doubtful, quantities, quantities),
        ]
        for place, table, *_ in tuple(tables):
            figures = {f"{place}.{key}": table[key] for key in quantities if isinstance(table.get(key), dict)}
            tables += [(key, figure, FigureEntry.model_fields, FIGURE_KEYS) for key, figure in figures.items()]
        for place, table, known, expected in tables:
            if unknown := [key for key in table if key not in known]:
                problem = f"{place} has the unknown key {shortened(unknown[0])}, expected {', '.join(expected)}"
                fault: Figures = {
                    "file": str(path),
                    "key": f"{place}.{shortened(unknown[0])[1:-1]}",
                    "problem": problem,
                }
                raise CuffsFileError(FitErrorCode.CUFFS_INVALID, fault)


def _wearable(name: str, entry: CuffEntry) -> Cuff:
    """The cuff of an entry. Figures under not_identified are kept, and their quantities are listed as missing.

    A fit writes a standard error with each figure, and its recordings; a figure without them is given by hand.
    """
    worn = [_estimate(getattr(entry, key)) for key in QUANTITIES.values()]
    doubtful = {key: _estimate(figure) for key, figure in (entry.not_identified or {}).items()}
    estimates = [
        doubtful.get(key) if estimate is None else estimate
        for estimate, key in zip(worn, QUANTITIES.values(), strict=True)
    ]
    missing = tuple(quantity for quantity, estimate in zip(QUANTITIES, worn, strict=True) if estimate is None)
    return Cuff(
        name=name,
        site=entry.site,
        donning=str(entry.donning),
        stiffness=estimates[0],
        damping=estimates[1],
        migration=estimates[2],
        missing=missing,
        verdicts=_verdicts(entry, missing),
        covariance=_covariance(entry, estimates),
        law=_law(entry),
        sources=entry.sources,
        origin=entry.origin,
        given=tuple(quantity for quantity, key in QUANTITIES.items() if _is_given(getattr(entry, key), entry)),
        notes=tuple(entry.notes),
        causes=tuple(Note(note.code, note.figures) for note in entry.note_codes if note.code in EXPLAINED_BY),
    )


def _is_given(figure: FigureEntry, entry: CuffEntry) -> bool:
    """Whether a figure with a value was entered by hand."""
    return figure.value is not None and (not entry.sources or figure.standard_error is None)


def _verdicts(entry: CuffEntry, missing: tuple[str, ...]) -> tuple[Verdict, ...]:
    """The verdicts of the file, without those on quantities whose value was entered by hand afterwards."""
    kept = (code for code in entry.verdict_codes if not code.quantities or set(code.quantities) & set(missing))
    return tuple(kept) or (Verdict.GIVEN,)


def _law(entry: CuffEntry) -> tuple[str, ...]:
    fitted = entry.model_class.extensions if entry.model_class else []
    given = entry.law.split(" + ") if entry.law else []
    tensors = (entry.stiffness_tensor_n_per_m, entry.damping_tensor_n_s_per_m)
    in_space = [TENSOR] if any(tensor and tensor.value for tensor in tensors) else []
    return tuple(name for name in dict.fromkeys([*fitted, *given, *in_space]) if name not in (KNOWN_LAW, KELVIN_VOIGT))


def _covariance(entry: CuffEntry, estimates: list[Estimate | None]) -> NDArray[np.float64]:
    """The covariance of the entry, or else that of independent estimates."""
    return joint_covariance(estimates) if entry.covariance is None else np.array(entry.covariance)


def _estimate(figure: FigureEntry) -> Estimate | None:
    """None without a value. A missing interval is that of a normal error."""
    if figure.value is None:
        return None
    error = figure.standard_error or 0.0
    low, high = figure.ci95 or (figure.value - NORMAL_95 * error, figure.value + NORMAL_95 * error)
    return Estimate(figure.value, error, (low, high), figure.parts, figure.cramer_rao_bound)
