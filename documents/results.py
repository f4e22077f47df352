"""Results that hold arrays: their equality, arrays with named axes for xarray, and HTML for a notebook.

The equality of a dataclass raises ValueError for arrays. xarray is an extra. The HTML has a title, a table of figures,
remarks, and a small drawing of curves.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    import xarray as xr

Curve = tuple[NDArray[np.float64], NDArray[np.float64]]
WIDTH, HEIGHT, MOST_POINTS = 260, 150, 200
COLOURS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#56b4e9")
"""Of Okabe and Ito (2008), as in the report."""


class EqualByFields:
    """Base of a dataclass with eq=False: equal if the types and all fields are, arrays element by element.

    NaN is equal to NaN, because it marks the same gap in both. Such an object has no hash.
    """

    __hash__ = None  # type: ignore[assignment]

    def __eq__(self, other: object) -> bool:
        return type(self) is type(other) and are_equal(self, other)


def are_equal(one: object, other: object) -> bool:
    """Whether two values are equal, within dataclasses, mappings and sequences also."""
    arrays = np.ndarray | np.generic | float
    if isinstance(one, arrays) and isinstance(other, arrays):
        one, other = np.asarray(one), np.asarray(other)
        has_gaps = one.dtype.kind in "fc" and other.dtype.kind in "fc"
        return bool(np.array_equal(one, other, equal_nan=has_gaps))
    if type(one) is not type(other):
        return not isinstance(one, np.ndarray) and not isinstance(other, np.ndarray) and bool(one == other)
    if is_dataclass(one) and not isinstance(one, type):
        return all(are_equal(getattr(one, field.name), getattr(other, field.name)) for field in fields(one))
    if isinstance(one, Mapping) and isinstance(other, Mapping):
        return one.keys() == other.keys() and all(are_equal(value, other[key]) for key, value in one.items())
    if isinstance(one, list | tuple) and isinstance(other, list | tuple):
        return len(one) == len(other) and all(map(are_equal, one, other))
    return bool(one == other)


def labelled_dataset(
    variables: Mapping[str, tuple[tuple[str, ...], Any, str]], coordinates: Mapping[str, tuple[Iterable[Any], str]]
) -> xr.Dataset:
    """A Dataset of name → (axes, values, unit) and axis → (labels, unit). Raises ImportError without xarray."""
    try:
        import xarray as xr
    except ModuleNotFoundError as error:
        raise ImportError("to_xarray() needs the package xarray; pip install 'cuffstation[xarray]'") from error
    data = {name: (axes, values, _attributes(unit)) for name, (axes, values, unit) in variables.items()}
    return xr.Dataset(data, {axis: (axis, list(of), _attributes(unit)) for axis, (of, unit) in coordinates.items()})


def _attributes(unit: str) -> dict[str, str]:
    return {"units": unit} if unit else {}


def result_html(
    title: str, header: Sequence[str], rows: Iterable[Sequence[str]], remark: str, drawing: str = ""
) -> str:
    """A fragment of a page; every text is escaped. drawing is that of curves_svg."""
    cells = ["<tr>" + "".join(f"<th>{escape(name)}</th>" for name in header) + "</tr>"]
    cells += ["<tr>" + "".join(f"<td>{escape(text)}</td>" for text in row) + "</tr>" for row in rows]
    table = f"<table>{''.join(cells)}</table>"
    return f"<div><b>{escape(title)}</b>{table}<p>{escape(remark)}</p>{drawing}</div>"


def curves_svg(curves: Sequence[Curve], horizontal: str, vertical: str) -> str:
    """Curves (x, y) in one frame with its limits; samples that are not finite are left out."""
    thinned = [(x[:: 1 + len(x) // MOST_POINTS], y[:: 1 + len(x) // MOST_POINTS]) for x, y in curves]
    finite = [np.column_stack(curve)[np.isfinite(curve).all(axis=0)] for curve in thinned]
    points = np.concatenate(finite) if finite else np.zeros((0, 2))
    if not len(points):
        return ""
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    scale = np.array([WIDTH, -HEIGHT]) / np.where(size > 0, size, 1.0)
    lines = "".join(
        f'<polyline fill="none" stroke="{COLOURS[number % len(COLOURS)]}" points="'
        + " ".join(f"{x:.1f},{y:.1f}" for x, y in (curve - low) * scale + [0, HEIGHT])
        + '"/>'
        for number, curve in enumerate(finite)
    )
    high = low + size
    texts = (
        f'<text x="0" y="{HEIGHT + 14}">{low[0]:.3g}</text>'
        f'<text x="{WIDTH}" y="{HEIGHT + 14}" text-anchor="end">{high[0]:.3g} {escape(horizontal)}</text>'
        f'<text x="{WIDTH + 4}" y="{HEIGHT}">{low[1]:.3g}</text>'
        f'<text x="{WIDTH + 4}" y="10">{high[1]:.3g} {escape(vertical)}</text>'
    )
    box = f"-2 -2 {WIDTH + 90} {HEIGHT + 22}"
    return (
        f'<svg viewBox="{box}" width="{WIDTH + 90}" font-size="11" fill="currentColor">'
        f'<rect width="{WIDTH}" height="{HEIGHT}" fill="none" stroke="#999"/>{lines}{texts}</svg>'
    )
