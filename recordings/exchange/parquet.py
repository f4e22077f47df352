"""Parquet: columns with their units, and notes about the file; a value that is not there is null."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import parquet


def write_parquet(
    path: Path, columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str], notes: Mapping[str, str]
) -> None:
    """Columns (n,) of one length under their names; units in the fields' metadata, notes in the file's."""
    fields = [pa.field(name, pa.float64(), metadata={"unit": units[name]}) for name in columns]
    arrays = [pa.array(values, from_pandas=True) for values in columns.values()]
    parquet.write_table(pa.table(arrays, schema=pa.schema(fields, metadata=dict(notes))), path)
