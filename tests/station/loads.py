"""Loads from outside, as OpenSim's files have them."""

from pathlib import Path

import numpy as np

from solver.bundled import bundled_model
from solver.time_series_table import write_table


def write_weight(path: Path, mass: float) -> None:
    """OpenSim's files of a weight at the hand's mass centre."""
    center = bundled_model().bodies[-1].mass_center.tolist()
    columns = ["time", *(f"{what}_{axis}" for what in ("force", "place") for axis in "xyz")]
    rows = [[time, 0.0, -9.80665 * mass, 0.0, *center] for time in (0.0, 10.0)]
    write_table(path.with_suffix(".mot"), columns[1:], np.array(rows)[:, 0], np.array(rows)[:, 1:])
    path.write_text(
        "<OpenSimDocument><ExternalLoads><objects><ExternalForce name='weight'><applied_to_body>hand</applied_to_body>"
        "<force_expressed_in_body>ground</force_expressed_in_body><point_expressed_in_body>hand"
        "</point_expressed_in_body><force_identifier>force_</force_identifier><point_identifier>place_"
        f"</point_identifier></ExternalForce></objects><datafile>{path.stem}.mot</datafile></ExternalLoads>"
        "</OpenSimDocument>",
        encoding="utf-8",
    )
