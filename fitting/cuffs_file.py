"""Read and write cuffs.json, as a fit wrote it or with values given by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from documents.plain_data import PlainDataError, read_json, shortened
from documents.validation import describe_error
from fitting.errors import FitError
from fitting.result import QUANTITIES, CuffFit, SessionFit, covariance_of
from fitting.results.codes import DOUBTED, Verdict
from fitting.results.format_0 import verdicts_in
from fitting.seal import SEAL, check_cuff
from fitting.uncertainty import NORMAL_95, Estimate
from recordings.manifest import DataOrigin, is_file_name


class CuffsFileError(FitError):
    """A cuffs.json that cannot be used; one sentence says where and what was expected."""


def read_cuffs(path: Path | str) -> dict[str, CuffFit]:
    """Read cuffs.json, also one written by hand that holds only values. Raises CuffsFileError."""
    path = Path(path)
    try:
        data = read_json(path)
    except OSError as error:
        raise CuffsFileError(
            f"{path} cannot be read: {error.strerror or error}; make one with `station fit`"
        ) from error
    except PlainDataError as error:
        raise CuffsFileError(f"{path} is not a cuffs file: it {error}; make one with `station fit`") from error
    if not (isinstance(data, dict) and isinstance(data.get("cuffs"), dict)):
        raise CuffsFileError(
            f'{path} is not a cuffs file, expected {{"cuffs": {{"hand": {{…}}}}}}; make one with `station fit`'
        )
    cuffs = data["cuffs"].items()
    if unnamed := [name for name in data["cuffs"] if not is_file_name(name)]:
        raise CuffsFileError(f"{path} has a cuff named {shortened(unnamed[0])}, expected no path: files are named so")
    seals = data[SEAL].get("cuffs") if isinstance(data.get(SEAL), dict) else None
    return {name: _cuff_from(name, cuff, seals, path) for name, cuff in cuffs}


def write_cuffs(path: Path | str, cuffs: Mapping[str, CuffFit]) -> None:
    """Write cuffs, by name, so that read_cuffs and `station assess` read them; what was there is replaced at once.

    Trials, tensors and diagnosis are written, too, but not read back. Raises OSError.
    """
    path = Path(path)
    text = SessionFit({name: {fit.donning: fit} for name, fit in cuffs.items()}, (), {}).to_json()
    drafted = path.with_name(f".{path.name}.draft")
    drafted.write_text(text, encoding="utf-8")
    drafted.replace(path)


class _Beside(BaseModel):
    """What stands beside the figures of a cuff, where anything does."""

    model_config = ConfigDict(strict=True, frozen=True)

    donning: str | int = ""
    verdict: str = ""
    verdict_codes: tuple[Annotated[Verdict, Field(strict=False)], ...] | None = None
    notes: tuple[str, ...] = ()
    sources: dict[str, str] = Field(default_factory=dict)
    diagnostics: dict[str, float] = Field(default_factory=dict)
    not_identified: dict[str, Any] | None = None


def _cuff_from(name: str, cuff: Any, seals: Any, path: Path) -> CuffFit:
    if not isinstance(cuff, dict):
        raise CuffsFileError(
            f"{path}: cuff {name} is {shortened(cuff)}, expected an object with {', '.join(QUANTITIES.values())}"
        )
    beside = _beside_from(cuff, f"{path}: {name}")
    estimates = [_quantity_from(cuff, key, f"{path}: {name}") for key in QUANTITIES.values()]
    site = cuff.get("site", "waist" if name == "waist" else "arm")
    if site not in ("arm", "waist"):
        raise CuffsFileError(f'{path}: {name}.site is {shortened(site)}, expected "arm" or "waist"')
    standing, given = check_cuff(name, cuff, seals, QUANTITIES)
    return CuffFit(
        name=name,
        site=site,
        donning=str(beside.donning),
        stiffness=estimates[0],
        damping=estimates[1],
        migration=estimates[2],
        verdicts=_verdicts_of(cuff, beside),
        covariance=_covariance_from(cuff.get("covariance"), covariance_of(estimates), f"{path}: {name}.covariance"),
        sources=beside.sources,
        origin=_origin_of(cuff),
        given=tuple(figure for figure in QUANTITIES if figure in given),
        standing=standing,
        notes=beside.notes,
        diagnostics=beside.diagnostics,
        energy=_estimate_from(cuff.get("hysteresis_energy_j"), f"{path}: {name}.hysteresis_energy_j"),
    )


def _origin_of(cuff: Mapping[str, Any]) -> DataOrigin:
    """Unknown where the file was written by hand, or by an older station."""
    try:
        return DataOrigin(cuff.get("origin", DataOrigin.UNKNOWN))
    except ValueError:
        return DataOrigin.UNKNOWN


def _beside_from(cuff: Mapping[str, Any], where: str) -> _Beside:
    given = {key: value for key, value in cuff.items() if key in _Beside.model_fields}
    for key in ("notes", "verdict_codes"):
        if isinstance(listed := given.get(key), list):
            given[key] = tuple(listed)
    try:
        return _Beside.model_validate(given)
    except ValidationError as error:
        raise CuffsFileError(describe_error(error, context=where)) from error


def _verdicts_of(cuff: Mapping[str, Any], beside: _Beside) -> tuple[Verdict, ...]:
    """By their codes; a figure that somebody wrote where a wearer looks is meant to be worn, whatever the verdict."""
    written = {name for name, key in QUANTITIES.items() if _estimate_from(cuff.get(key), key) is not None}
    codes = verdicts_in(beside.verdict) if beside.verdict_codes is None else beside.verdict_codes
    kept = (code for code in codes if not (DOUBTED.get(code) and written.issuperset(DOUBTED[code])))
    return tuple(kept) or (Verdict.GIVEN,)


def _quantity_from(cuff: Mapping[str, Any], key: str, where: str) -> Estimate | None:
    """As identified, or as what the trials gave all the same."""
    found = _estimate_from(cuff.get(key), f"{where}.{key}")
    doubtful = cuff.get("not_identified") or {}
    return found or _estimate_from(doubtful.get(key), f"{where}.not_identified.{key}")


def _covariance_from(entry: Any, independent: NDArray[np.float64], where: str) -> NDArray[np.float64]:
    """Where there is none, that of independent estimates."""
    if entry is None:
        return independent
    try:
        covariance = np.asarray(entry, dtype=np.float64)
    except (TypeError, ValueError):
        covariance = np.zeros(0)
    if covariance.shape != (3, 3) or not np.isfinite(covariance).all() or np.diag(covariance).min() < 0:
        raise CuffsFileError(
            f"{where} is {shortened(entry)}, expected 3 rows of 3 finite numbers, none below 0 in the diagonal"
        )
    return covariance


def _estimate_from(entry: Any, where: str) -> Estimate | None:
    """An estimate from an object of which only "value" must be there, or from a bare number."""
    plain = entry if isinstance(entry, dict) else {"value": entry}
    if plain.get("value") is None:
        return None
    value, error = plain["value"], plain.get("standard_error") or 0.0
    if not all(map(_is_finite, (value, error))) or error < 0:
        raise CuffsFileError(
            f"{where} is {shortened(entry)}, expected a finite number as value, and no standard_error below 0"
        )
    ends = plain.get("ci95") or [value - NORMAL_95 * error, value + NORMAL_95 * error]
    if not (isinstance(ends, list) and len(ends) == 2 and all(map(_is_finite, ends)) and ends[0] <= ends[1]):
        raise CuffsFileError(f"{where} is {shortened(entry)}, expected two finite numbers, the lower first, as ci95")
    low, high = ends
    parts, bound = plain.get("parts") or {}, plain.get("cramer_rao_bound")
    if not (isinstance(parts, dict) and all(map(_is_finite, parts.values())) and (bound is None or _is_finite(bound))):
        raise CuffsFileError(f"{where} is {shortened(entry)}, expected numbers as cramer_rao_bound and in its parts")
    return Estimate(
        float(value),
        float(error),
        (float(low), float(high)),
        {cause: float(part) for cause, part in parts.items()},
        None if bound is None else float(bound),
    )


def _is_finite(number: Any) -> bool:
    return isinstance(number, int | float) and not isinstance(number, bool) and math.isfinite(number)
