"""Intervals hold the true value as often as they say, over studies that are drawn without the code of the fit."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from fitting.study.cuff_study import Observation, analyse, compare

SD = {"volunteer": 800.0, "volunteer_by_cuff": 300.0, "donning": 300.0, "repeat": 60.0, "operator": 250.0}
MEAN, DIFFERENCE, NOISE = 5000.0, -1500.0, 25.0


def test_twelve_studies_are_mostly_in_their_intervals() -> None:
    """Of 12 intervals of 95 %, fewer than 9 hold the true value in 0.02 % of cases."""
    assert min(coverage(12, seed=4).values()) >= 0.75


@pytest.mark.slow
def test_five_hundred_studies_are_covered_by_93_to_97_percent() -> None:
    """An interval that ends at zero covers more: that of three operators has no upper limit here."""
    runs = [coverage(250, seed) for seed in (3, 4)]
    found = {name: sum(run[name] for run in runs) / len(runs) for name in runs[0]}
    operators = found.pop("sd of operator")
    assert operators >= 0.93
    assert {name: part for name, part in found.items() if not 0.93 <= part <= 0.97} == {}


def coverage(studies: int, seed: int) -> dict[str, float]:
    """Quantity → part of the studies whose interval holds the true value."""
    rng = np.random.default_rng(seed)
    counts: dict[str, int] = {}
    for _ in range(studies):
        for name, is_held in covered(rng):
            counts[name] = counts.get(name, 0) + is_held
    return {name: count / studies for name, count in counts.items()}


def draw_study(
    rng: np.random.Generator, volunteers: int = 12, operators: int = 3, repeats: int = 2, cuffs: int = 1
) -> tuple[list[Observation], float]:
    """A study, and the mean of one donning of a new volunteer by a new operator."""
    operator_offsets = SD["operator"] * rng.standard_normal(operators)
    found = []
    for volunteer in range(volunteers):
        own = SD["volunteer"] * rng.standard_normal()
        for cuff in range(cuffs):
            with_cuff = SD["volunteer_by_cuff"] * rng.standard_normal() if cuffs > 1 else 0.0
            for operator in range(operators):
                donned = SD["donning"] * rng.standard_normal()
                centre = MEAN + cuff * DIFFERENCE + own + with_cuff + operator_offsets[operator] + donned
                for repeat in range(repeats):
                    value = centre + SD["repeat"] * rng.standard_normal() + NOISE * rng.standard_normal()
                    session = f"{volunteer} {operator}"
                    found.append(
                        Observation(value, NOISE, 0.0, str(volunteer), str(operator), session, "1", repeat, str(cuff))
                    )
    new = [SD[name] * rng.standard_normal() for name in ("volunteer", "operator", "donning")]
    of_repeats = np.hypot(SD["repeat"], NOISE) / np.sqrt(repeats) * rng.standard_normal()
    return found, MEAN + sum(new) + of_repeats


def covered(rng: np.random.Generator) -> Iterator[tuple[str, bool]]:
    """Whether each interval of one drawn study holds its true value."""
    measurements, new = draw_study(rng)
    study = analyse(measurements)
    for component in study.model.estimated:
        yield f"sd of {component.name}", _holds(component.ci95, SD[component.name] ** 2)
    error = sum(SD[name] ** 2 for name in ("operator", "donning", "repeat")) + NOISE**2
    yield "SEM", _holds(study.reliability.sem.ci95, np.sqrt(error))
    yield "ICC(2,1)", _holds(study.reliability.icc.ci95, SD["volunteer"] ** 2 / (SD["volunteer"] ** 2 + error))
    yield "mean", _holds(study.mean.ci95, MEAN)
    yield "prediction", _holds(study.prediction.ci95, new)
    measurements, _ = draw_study(rng, volunteers=8, cuffs=2)
    difference = compare(measurements, "0", "1").difference
    yield "difference of cuffs", _holds(difference.ci95, DIFFERENCE)


def _holds(ends: tuple[float, float], true: float) -> bool:
    return bool(ends[0] <= true <= ends[1])
