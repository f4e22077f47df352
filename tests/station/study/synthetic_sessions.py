"""Session folders as `station record` and `station fit` leave them, with fitted values drawn from known spreads.

Only session.jsonl and cuffs.json are written. The values are drawn here from normal distributions, without the code
that estimates the components.
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from station.journal import Setup, write_setup

CUFF_FACTORS = {"hand": 1.6, "tube": 1.0}


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviations of a quantity, between levels, and its noise."""

    mean: float
    volunteer: float
    operator: float
    donning: float
    repeat: float
    noise: float


STIFFNESS = Spread(5000.0, 800.0, 150.0, 300.0, 60.0, 25.0)
DAMPING = Spread(120.0, 25.0, 4.0, 12.0, 3.0, 5.0)
MIGRATION = Spread(0.012, 0.003, 0.0005, 0.002, 0.0, 0.00002)


def write_sessions(
    folder: Path,
    volunteers: int,
    *,
    operators: int = 2,
    donnings: int = 2,
    repeats: int = 2,
    seed: int = 1,
    origin: str = "measured",
) -> list[Path]:
    """A session for every volunteer and operator below the folder, with both cuffs."""
    rng = np.random.default_rng(seed)
    operator_offsets = rng.standard_normal((operators, 3))
    sessions = []
    for volunteer in range(volunteers):
        own = rng.standard_normal((len(CUFF_FACTORS), 3))
        for operator in range(operators):
            session = folder / f"sub-P{volunteer + 1:02}_ses-{operator + 1}"
            setup = Setup(f"P{volunteer + 1:02}", "AB"[operator % 2] + str(operator), tuple(CUFF_FACTORS), repeats)
            write_setup(session, setup)
            cuffs = {
                name: _cuff(name, factor, own[i], operator_offsets[operator], donnings, repeats, rng)
                for i, (name, factor) in enumerate(CUFF_FACTORS.items())
            }
            document = {"format": 1, "origin": origin, "cuffs": cuffs}
            (session / "cuffs.json").write_text(json.dumps(document), encoding="utf-8")
            sessions.append(session)
    return sessions


def _cuff(
    name: str,
    factor: float,
    volunteer: np.ndarray,
    operator: np.ndarray,
    donnings: int,
    repeats: int,
    rng: np.random.Generator,
) -> dict[str, Any]:
    found = {}
    for donning in range(1, donnings + 1):
        offset = rng.standard_normal(3)
        centres = [
            spread.mean + spread.volunteer * volunteer[i] + spread.operator * operator[i] + spread.donning * offset[i]
            for i, spread in enumerate((STIFFNESS, DAMPING, MIGRATION))
        ]
        trials = []
        for test, key, centre, spread in (
            ("static", "stiffness_n_per_m", centres[0], STIFFNESS),
            ("dynamic", "damping_n_s_per_m", centres[1], DAMPING),
        ):
            for repeat in range(1, repeats + 1):
                file = f"cuff-{name}_test-{test}_run-{(donning - 1) * repeats + repeat}.mcap"
                noise = factor * spread.repeat * rng.standard_normal() + spread.noise * rng.standard_normal()
                figure = _figure(factor * centre + noise, spread.noise)
                trial = {"file": file, "test": test, "repeat": repeat, "run": repeat, "state": "used"}
                trials.append(trial | {"reason": "", "notes": [], key: figure})
        found[str(donning)] = {
            "stiffness_n_per_m": _figure(factor * centres[0], STIFFNESS.noise),
            "damping_n_s_per_m": _figure(factor * centres[1], DAMPING.noise),
            "migration_m": _figure(factor * centres[2], MIGRATION.noise),
            "donning": str(donning),
            "origin": "measured",
            "verdict_codes": ["identified"],
            "trials": trials,
        }
    return {**found[str(donnings)], "donnings": found}


def _figure(value: float, error: float) -> dict[str, Any]:
    return {"value": value, "standard_error": error, "ci95": [value - 2 * error, value + 2 * error]}
