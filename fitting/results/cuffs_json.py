"""The text of cuffs.json from a fit; the same fit gives the same bytes."""

from __future__ import annotations

import json
from dataclasses import asdict
from typing import Any

from fitting.plain import (
    plain_bands,
    plain_calibration,
    plain_classes,
    plain_diagnosis,
    plain_estimate,
    plain_swing,
    plain_sync,
)
from fitting.result import CuffFit, Lag, SessionFit, TrialFit
from fitting.results.cuffs_schema import FORMAT, CuffEntry, CuffsDocument
from fitting.seal import SEAL, digest, seal_cuff
from fitting.spatial.tensor import Tensors, plain_tensor
from fitting.wearable_cuff import QUANTITIES


def cuffs_json(session: SessionFit) -> str:
    """As CuffsDocument has it, with a seal over what is written."""
    cuffs = {name: _written(session, name) for name in session.cuffs}
    plain: dict[str, Any] = {
        "format": FORMAT,
        "origin": session.origin,
        "cuffs": cuffs,
        "rejected": [
            {"file": trial.file, "reason": trial.reason, "damage": list(trial.damage)} for trial in session.rejected
        ],
        "calibration": plain_calibration(session.calibration),
        "recordings": {file: asdict(checked) for file, checked in session.recordings.items()},
    }
    plain[SEAL] = {
        "cuffs": {name: seal_cuff(cuff, QUANTITIES) for name, cuff in cuffs.items()},
        "session": digest({key: value for key, value in plain.items() if key != "cuffs"}),
    }
    document = CuffsDocument.model_validate(plain).model_dump(mode="json", by_alias=True, exclude_unset=True)
    return json.dumps(document, indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _written(session: SessionFit, name: str) -> dict[str, Any]:
    """A cuff as last donned, and in each donning."""
    donnings = {donning: _plain_cuff(fit) for donning, fit in session.donnings[name].items()}
    entry = CuffEntry.model_validate({**_plain_cuff(session.cuffs[name]), "donnings": donnings})
    return entry.model_dump(mode="json", by_alias=True, exclude_unset=True)


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
        "notes": list(map(str, fit.notes)),
        "note_codes": [{"code": note.code, "figures": dict(note.figures)} for note in fit.notes],
        "diagnostics": dict(fit.diagnostics),
        **({"lag": _plain_lag(fit.lag)} if fit.lag else {}),
        **({"static": dict(fit.held)} if fit.held else {}),
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
