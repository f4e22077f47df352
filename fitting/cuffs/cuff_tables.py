"""Cuffs from objects in Python: fits, cuffs, mappings, rows of a table, or a cuffs.json."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from fitting.cuffs.cuff_fit import CuffFit, SessionFit
from fitting.cuffs.cuffs_file import read_cuffs
from fitting.cuffs.wearable_cuff import QUANTITIES, Cuff
from fitting.errors import CodedError
from fitting.results.codes import FitErrorCode

if TYPE_CHECKING:
    import pandas as pd

    One: TypeAlias = Cuff | CuffFit | Mapping[str, Any] | pd.Series[Any]
    CuffsLike: TypeAlias = One | SessionFit | Mapping[str, One] | pd.DataFrame | Sequence[One] | PathLike[str] | str
else:
    CuffsLike = Any  # pandas loads at its first use

NAMES = ("name", "cuff")
"""Keys of the name of a cuff, in a mapping or a table."""
_QUANTITY_OF = {key: quantity for quantity, suffixed in QUANTITIES.items() for key in (quantity, suffixed)}
_OTHERS = ("site", "donning")


class UnnamedCuff(CodedError):
    """Keys that do not make a cuff: unknown ones, or no name."""


def published_cuffs() -> dict[str, Cuff]:
    """The four cuffs of the source study (its Table 2), by name: waist, hand, tube and elbow."""
    table = (
        ("waist", 2140, 124, 0.012),
        ("hand", 8520, 210, 0.012),
        ("tube", 5510, 38, 0.009),
        ("elbow", 2530, 139, 0.022),
    )
    return {name: Cuff(name, stiffness=k, damping=c, migration=slip) for name, k, c, slip in table}


def cuffs_by_name(given: CuffsLike) -> dict[str, Cuff]:
    """Cuffs by name, of any of these:

    - a Cuff, CuffFit or SessionFit, or a sequence or a mapping of them;
    - a mapping or a row of a table with name, stiffness [N/m], damping [N s/m] and migration [m], also with the keys of
      cuffs.json; a mapping from names to such mappings; a DataFrame with a row per cuff, named by its column "name" or
      its index, or with a row per quantity, as to_dataframe() returns;
    - the path of a cuffs.json.

    Raises FitError for unknown keys, impossible values and an unusable file, and TypeError for anything else.
    """
    if isinstance(given, str | PathLike):
        return read_cuffs(Path(given))
    if hasattr(given, "iterrows"):
        return _of_table(given)
    if isinstance(given, SessionFit):
        given = given.cuffs
    if isinstance(given, Mapping) and not _is_cuff(given):
        return {str(name): _cuff(cuff, str(name)) for name, cuff in given.items()}
    if isinstance(given, Sequence):
        return _by_name([_cuff(cuff) for cuff in given])
    return _by_name([_cuff(given)])


def _by_name(cuffs: Sequence[Cuff]) -> dict[str, Cuff]:
    found = {cuff.name: cuff for cuff in cuffs}
    names = [cuff.name for cuff in cuffs]
    if twice := [name for name in found if names.count(name) > 1]:
        raise UnnamedCuff(FitErrorCode.CUFF_TWICE, {"cuff": twice[0], "count": names.count(twice[0])})
    return found


def _is_cuff(given: Mapping[Any, Any]) -> bool:
    """Whether it is a mapping with the figures of one cuff."""
    return any(key in given for key in _QUANTITY_OF)


def _cuff(given: Any, name: str = "") -> Cuff:
    """One cuff. Raises TypeError for anything that is none."""
    if isinstance(given, CuffFit):
        return given.wearable()
    if isinstance(given, Cuff):
        return given
    if hasattr(given, "to_frame"):  # a row of a DataFrame, which may be named by the index
        fallback = given.name if isinstance(given.name, str) else ""
        return _of_keys(given.to_dict(), name or fallback)
    if isinstance(given, Mapping):
        return _of_keys(given, name)
    raise TypeError(
        "cuffs should be cuffs by name, as fit_session(…).cuffs is, cuffs, rows of a table or the path of a "
        f"cuffs.json, and got a {type(given).__name__}"
    )


def _of_keys(given: Mapping[Any, Any], name: str) -> Cuff:
    given = {key: value for key, value in given.items() if not _is_gap(value)}
    figures = {_QUANTITY_OF[key]: _number(value) for key, value in given.items() if key in _QUANTITY_OF}
    name = name or str(next((given[key] for key in NAMES if key in given), ""))
    if not name:
        raise UnnamedCuff(FitErrorCode.CUFF_NAME, {"keys": ", ".join(map(str, given))})
    if unknown := [str(key) for key in given if key not in (*_QUANTITY_OF, *NAMES, *_OTHERS)]:
        expected = f"{', '.join(QUANTITIES)} [N/m, N s/m, m] and {', '.join(_OTHERS)}"
        raise UnnamedCuff(FitErrorCode.CUFF_KEY, {"cuff": name, "key": unknown[0], "expected": expected})
    if twice := [key for key in QUANTITIES if key in given and QUANTITIES[key] in given]:
        expected = f"{twice[0]} alone"
        raise UnnamedCuff(FitErrorCode.CUFF_KEY, {"cuff": name, "key": QUANTITIES[twice[0]], "expected": expected})
    return Cuff(name, **figures, **{key: given[key] for key in _OTHERS if key in given})


def _number(figure: Any) -> Any:
    """The figure; of an object of cuffs.json, its value and standard error."""
    if not isinstance(figure, Mapping):
        return figure
    value, error = figure.get("value"), figure.get("standard_error")
    return value if value is None or error is None else (value, error)


def _of_table(table: Any) -> dict[str, Cuff]:
    """Of a row per cuff, or of a row per quantity; then of the last donning of a cuff, as SessionFit.cuffs."""
    if not {"cuff", "quantity", "value"} <= set(table.columns):
        return _by_name([_cuff(row) for _, row in table.iterrows()])
    is_known = table["is_identified"] if "is_identified" in table else table["value"].notna()
    cuffs = {}
    for (name, donning), rows in table[is_known].groupby(["cuff", "donning"], sort=False):
        figures = rows.set_index("quantity")[["value", "standard_error"]].itertuples(name=None)
        given = {key: (value, error) for key, value, error in figures}
        cuffs[str(name)] = _of_keys({**given, "donning": donning}, str(name))
    return cuffs


def _is_gap(value: object) -> bool:
    """Whether a cell of a table is empty."""
    return value is None or (isinstance(value, float) and math.isnan(value))
