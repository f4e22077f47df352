"""Coverage of the intervals of a study, and its time: `python -m benchmarks.study`.

Studies are drawn from known variances with numpy alone, and analysed by fitting/study. An interval of 95 % should hold
the true value in 95 % of the studies; with 500 studies the standard error of that figure is 1.0 %.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from time import process_time

import numpy as np

from fitting.study.cuff_study import analyse, compare
from fitting.study.measurements import Observation

SD = {"volunteer": 800.0, "volunteer_by_cuff": 300.0, "donning": 300.0, "repeat": 60.0, "operator": 250.0}
MEAN, DIFFERENCE, NOISE = 5000.0, -1500.0, 25.0


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


def coverage(studies: int, seed: int) -> dict[str, float]:
    """Quantity → part of the studies whose interval holds the true value."""
    rng = np.random.default_rng(seed)
    counts: dict[str, int] = {}
    for _ in range(studies):
        for name, is_held in covered(rng):
            counts[name] = counts.get(name, 0) + is_held
    return {name: count / studies for name, count in counts.items()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--studies", type=int, default=500)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    begun = process_time()
    for name, part in coverage(options.studies, options.seed).items():
        print(f"{name:22} {100 * part:5.1f} %")
    print(f"{options.studies} studies: {process_time() - begun:.0f} s of processor")
    for volunteers in (12, 40):
        measurements, _ = draw_study(np.random.default_rng(0), volunteers)
        begun = process_time()
        analyse(measurements)
        print(f"{volunteers} volunteers, {len(measurements)} values: {process_time() - begun:.2f} s of processor")


def _holds(ends: tuple[float, float], true: float) -> bool:
    return bool(ends[0] <= true <= ends[1])


if __name__ == "__main__":
    main()
