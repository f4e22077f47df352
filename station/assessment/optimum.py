"""cuffs.json → optimum.json and suit.toml: the cord that saves most, as fitted and on average over the draws."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from recordings.manifest import DataOrigin
from solver.cuff import by_site
from solver.suit.optimise import Freedom, OptimisedSuit, SuitCandidate, optimise_suit
from solver.suit.scenarios import Condition
from solver.suit.suit import PARTS, Suit, suit_toml
from station.assessment.assessment_inputs import (
    AssessmentInputs,
    InputError,
    cuff_remarks,
    ensure_folder,
    read_cuffs_to_wear,
    worn_cuffs,
)
from station.assessment.assessment_json import known
from station.checksums import write_checksums
from station.progress import Progress, silent
from station.versions import solving_versions
from station.whole_file import write_whole


def optimise_file(
    inputs: AssessmentInputs,
    output: Path,
    condition: Condition = "both",
    free: tuple[Freedom, ...] = (),
    draws: int = 50,
    progress: Progress = silent,
) -> OptimisedSuit:
    """Search for one arm cuff in one condition; writes optimum.json, and the suits found, for `assess --suit`.

    suit.toml is the best with the fitted cuffs, robust_suit.toml that on average over the draws, if there are any.
    """
    ensure_folder(output)
    cuffs = read_cuffs_to_wear(inputs.cuffs, inputs.chosen)
    arms, waists = by_site(worn_cuffs(cuffs, inputs.chosen))
    if len(arms) != 1 or len(waists) > 1:
        names = ", ".join(cuff.name for cuff in arms) or "none"
        raise InputError(f"a suit is optimised for one arm cuff at a time and there are {names}; choose one by --cuff")
    model = inputs.read_model()
    kinematics, suit = inputs.read_motion(model), inputs.read_suit()
    found = optimise_suit(
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
        "origin": DataOrigin.joined(cuffs[cuff.name].origin for cuff in (*arms, *waists)),
        "cuff": arms[0].name,
        "free": ["rest_length", *free],
        **_plain_suits(found),
        "remarks": cuff_remarks(inputs.cuffs, (cuffs[cuff.name] for cuff in (*arms, *waists))),
        "inputs": inputs.hashes(),
        "versions": solving_versions(),
    }
    write_whole(output / "optimum.json", json.dumps(plain, indent=2, ensure_ascii=False, allow_nan=False) + "\n")
    _write_suit(output / "suit.toml", found.fitted, f"the best of {found.tried} suits tried with {arms[0].name}")
    if draws := found.robust.drawn.size:
        _write_suit(output / "robust_suit.toml", found.robust, f"the best on average over {draws} draws of the cuffs")
    written = ("optimum.json", "suit.toml", *(("robust_suit.toml",) if found.robust.drawn.size else ()))
    write_checksums(*(output / name for name in written))
    return found


def _write_suit(path: Path, tried: SuitCandidate, which: str) -> None:
    origin = f"# A suit found by `station optimise`: {which}; optimum.json says more."
    write_whole(path, f"{origin}\n\n{suit_toml(tried.suit)}")


def _plain_suits(found: OptimisedSuit) -> dict[str, Any]:
    return {
        "start": _plain(found.start),
        "optimum": _plain(found.fitted),
        "robust_optimum": _plain(found.robust),
        "suits_tried": known(found.tried),
    }


def _plain(tried: SuitCandidate) -> dict[str, Any]:
    """Cost with the fitted cuffs on all frames; the draws' are on fewer, so they have a value of their own."""
    numbers: dict[str, Any] = {**_cord(tried.suit), "normalised_cost": known(tried.cost)}
    numbers["at_limit"] = list(tried.at_limit)
    numbers["outcome"] = tried.outcome
    if tried.drawn.size:
        low, high = np.quantile(tried.drawn, [0.025, 0.975])
        numbers["normalised_cost_of_draws"] = {"value": float(tried.drawn.mean()), "ci95": [float(low), float(high)]}
    return numbers


def _cord(suit: Suit) -> dict[str, Any]:
    points = {f"{part}_point_m": [known(float(x)) for x in getattr(suit, part).location] for part in PARTS}
    return {
        "rest_length_m": known(suit.reference_rest_length),
        "stiffness_n_per_m": known(suit.stiffness),
        **points,
    }
