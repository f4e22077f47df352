"""cuffs.json → optimum.json and suit.toml: the cord that saves most, as fitted and on average over the draws."""

from __future__ import annotations

import json
from importlib import metadata
from pathlib import Path
from typing import Any

import numpy as np

from solver.optimise import Freedom, Optimised, TriedSuit, optimise
from solver.suit import PARTS, Suit, suit_toml
from solver.worn import Condition
from station.assessment_inputs import AssessmentInputs, InputError, ensure_folder, read_cuffs_to_wear, worn_cuffs
from station.progress import Progress, silent
from station.whole_file import write_whole


def optimise_file(
    inputs: AssessmentInputs,
    output: Path,
    condition: Condition = "both",
    free: tuple[Freedom, ...] = (),
    draws: int = 50,
    progress: Progress = silent,
) -> Optimised:
    """Search for one arm cuff in one condition; writes optimum.json, and the suits found, for `assess --suit`.

    suit.toml is the best with the fitted cuffs, robust_suit.toml that on average over the draws, if there are any.
    """
    ensure_folder(output)
    worn = worn_cuffs(read_cuffs_to_wear(inputs.cuffs, inputs.chosen), inputs.chosen)
    arms, waists = ([cuff for cuff in worn if cuff.site == site] for site in ("arm", "waist"))
    if len(arms) != 1 or len(waists) > 1:
        names = ", ".join(cuff.name for cuff in arms) or "none"
        raise InputError(f"a suit is optimised for one arm cuff at a time and there are {names}; choose one by --cuff")
    model = inputs.read_model()
    kinematics, suit = inputs.read_motion(model), inputs.read_suit()
    found = optimise(
        model,
        kinematics,
        suit,
        waists[0] if waists else None,
        arms[0],
        condition,
        free,
        draws=draws,
        loads=inputs.read_loads(model, kinematics),
        progress=progress,
    )
    plain = {
        "condition": condition,
        "cuff": arms[0].name,
        "free": ["rest_length", *free],
        "start": _plain(found.start),
        "optimum": _plain(found.fitted),
        "robust_optimum": _plain(found.robust),
        "suits_tried": found.tried,
        "inputs": inputs.hashes(),
        "versions": {name: metadata.version(name) for name in ("cuffstation", "numpy", "scipy")},
    }
    write_whole(output / "optimum.json", json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    _write_suit(output / "suit.toml", found.fitted, f"the best of {found.tried} suits tried with {arms[0].name}")
    if draws := found.robust.drawn.size:
        _write_suit(output / "robust_suit.toml", found.robust, f"the best on average over {draws} draws of the cuffs")
    return found


def _write_suit(path: Path, tried: TriedSuit, which: str) -> None:
    origin = f"# A suit found by `station optimise`: {which}; optimum.json says more."
    write_whole(path, f"{origin}\n\n{suit_toml(tried.suit)}")


def _plain(tried: TriedSuit) -> dict[str, Any]:
    """Cost with the fitted cuffs on all frames; the draws' are on fewer, so they have a value of their own."""
    numbers: dict[str, Any] = {**_cord(tried.suit), "normalised_cost": _number(tried.cost)}
    numbers["at_limit"] = list(tried.at_limit)
    if tried.drawn.size:
        low, high = np.quantile(tried.drawn, [0.025, 0.975])
        numbers["normalised_cost_of_draws"] = {"value": float(tried.drawn.mean()), "ci95": [float(low), float(high)]}
    return numbers


def _cord(suit: Suit) -> dict[str, Any]:
    points = {f"{part}_point_m": [_number(float(x)) for x in getattr(suit, part).location] for part in PARTS}
    return {
        "rest_length_m": _number(suit.reference_rest_length),
        "stiffness_n_per_m": _number(suit.stiffness),
        **points,
    }


def _number(value: float) -> dict[str, Any]:
    return {"value": value if np.isfinite(value) else None, "ci95": None}
