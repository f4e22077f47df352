"""Read and write cuffs.json, as a fit wrote it or with values given by hand."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from documents.plain_data import PlainDataError, read_json, shortened
from documents.regular_file import path_of, replaced
from documents.validation import describe_error, faulty_key
from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_json import cuffs_json
from fitting.cuffs.wearable_cuff import KNOWN_LAW, QUANTITIES, TENSOR, Cuff, covariance_of
from fitting.errors import CodedError
from fitting.laws.model_class import KELVIN_VOIGT
from fitting.results.codes import EXPLAINED_BY, UNIDENTIFIED_BY, FitErrorCode, Verdict
from fitting.results.cuffs_schema import FORMAT, CuffEntry, CuffsDocument, FigureEntry
from fitting.results.rendering import Figures, Note
from fitting.uncertainty import NORMAL_95, Estimate
from recordings.manifest import is_file_name

CUFFS_FILE = "cuffs.json"
"""Its name in a session folder."""
FIGURE_KEYS = ("value", "standard_error", "ci95")
"""Of a figure that is written by hand."""


class CuffsFileError(CodedError):
    """A cuffs.json that cannot be used."""


def read_cuffs(path: Path | str) -> dict[str, Cuff]:
    """Read the cuffs of a cuffs.json by name, also of one written by hand. Raises CuffsFileError."""
    path = path_of("path", path)
    return {name: _wearable(name, entry) for name, entry in _validated(path, _read_document(path)).cuffs.items()}


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
    with replaced(path_of("path", path), with_folder=False) as draft:
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
    kept = (
        code for code in entry.verdict_codes if code not in UNIDENTIFIED_BY or set(UNIDENTIFIED_BY[code]) & set(missing)
    )
    return tuple(kept) or (Verdict.GIVEN,)


def _law(entry: CuffEntry) -> tuple[str, ...]:
    fitted = entry.model_class.extensions if entry.model_class else []
    given = entry.law.split(" + ") if entry.law else []
    tensors = (entry.stiffness_tensor_n_per_m, entry.damping_tensor_n_s_per_m)
    in_space = [TENSOR] if any(tensor and tensor.value for tensor in tensors) else []
    return tuple(name for name in dict.fromkeys([*fitted, *given, *in_space]) if name not in (KNOWN_LAW, KELVIN_VOIGT))


def _covariance(entry: CuffEntry, estimates: list[Estimate | None]) -> NDArray[np.float64]:
    """The covariance of the entry, or else that of independent estimates."""
    return covariance_of(estimates) if entry.covariance is None else np.array(entry.covariance)


def _estimate(figure: FigureEntry) -> Estimate | None:
    """None without a value. A missing interval is that of a normal error."""
    if figure.value is None:
        return None
    error = figure.standard_error or 0.0
    low, high = figure.ci95 or (figure.value - NORMAL_95 * error, figure.value + NORMAL_95 * error)
    return Estimate(figure.value, error, (low, high), figure.parts, figure.cramer_rao_bound)
