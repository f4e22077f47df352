"""Arrays with named axes for xarray, which is an extra."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import xarray as xr


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
