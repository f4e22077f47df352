"""Covariance of body sizes, and body mass over arm length, from the public tables of ANSUR II.

    python -m benchmarks.anthropometry ANSUR_II_MALE_Public.csv ANSUR_II_FEMALE_Public.csv

Men and women have equal weight. Prints 1e4 times the covariance of ln(dimension), and the differences from the figures
in solver/personalisation. Exit code 1: they differ by more than their last digit.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from solver.personalisation.anthropometry import LOG_COVARIANCE, SIZE_FACTORS
from solver.personalisation.segment_masses import MASS_DEVIATION, MASS_EXPONENT

Array = NDArray[np.float64]

DIMENSIONS: dict[str, Callable[[pd.DataFrame], pd.Series]] = {
    "chest depth": lambda table: table.chestdepth,
    "suprasternal height less tenth rib height": lambda table: table.suprasternaleheight - table.tenthribheight,
    "chest breadth": lambda table: table.chestbreadth,
    "biacromial breadth": lambda table: table.biacromialbreadth,
    "shoulder length": lambda table: table.shoulderlength,
    "acromion-radiale length": lambda table: table.acromionradialelength,
    "radiale-stylion length": lambda table: table.radialestylionlength,
}


def main(paths: list[str]) -> int:
    sexes = [pd.read_csv(Path(path), encoding="latin-1") for path in paths]
    logs = [_logs(table, [DIMENSIONS[factor.dimension](table) for factor in SIZE_FACTORS]) for table in sexes]
    covariance = _pooled(logs)
    mass = _pooled([_logs(table, [table.acromionradialelength, table.weightkg]) for table in sexes])
    exponent = mass[0, 1] / mass[0, 0]
    deviation = float(np.sqrt(mass[1, 1] - exponent * mass[0, 1]))
    print((1e4 * covariance).round(1))
    print(f"ln(mass) = {exponent:.2f} ln(acromion-radiale length) + …, standard deviation {deviation:.3f}")
    away = 1e4 * float(np.abs(covariance - LOG_COVARIANCE).max())
    print(f"largest difference from the figures in use: {away:.2f} of 1e-4")
    return int(away > 0.06 or abs(exponent - MASS_EXPONENT) > 0.005 or abs(deviation - MASS_DEVIATION) > 0.0005)


def _logs(table: pd.DataFrame, columns: list[pd.Series]) -> Array:
    values = np.column_stack([column.to_numpy(dtype=np.float64) for column in columns])
    return np.log(values[(values > 0).all(axis=1)]) if len(table) else values


def _pooled(logs: list[Array]) -> Array:
    """Covariance of a population with equal numbers of men and women."""
    means = np.array([values.mean(axis=0) for values in logs])
    between = means - means.mean(axis=0)
    within = np.mean([np.cov(values.T) for values in logs], axis=0)
    pooled: Array = within + between.T @ between / len(logs)
    return pooled


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
