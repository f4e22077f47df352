"""OpenSim's own values: certified.json for the bundled model, and golden.npz beside the repository."""

import json
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SHARED = Path(__file__).parents[2].parent / "shared" / "data"
NO_WEIGHT = SHARED / "models" / "TSM_subject_noWeight.osim"
TWO_KILOGRAM_WEIGHT = SHARED / "models" / "TSM_subject_2kgWeight.osim"


@cache
def certified() -> dict[str, Array]:
    """Each quantity (states, …) of certified.json."""
    states = json.loads(Path(__file__).with_name("certified.json").read_text(encoding="utf-8"))["states"]
    return {name: np.array([state[name] for state in states]) for name in states[0]}


@cache
def golden() -> dict[str, Array]:
    """Each quantity (states, …) of golden.npz, under the names it has in certified.json."""
    stored = np.load(SHARED / "golden.npz")
    return {
        "q": stored["q"],
        "u": stored["u"],
        "rates": stored["qdot"],
        "rotation": stored["R"],
        "origin": stored["p"],
        "velocity": stored["V"],
        "mass_matrix": stored["M"],
        "constraint_jacobian": stored["G"],
        "constraint_bias": stored["bias"],
        "constraint_gap": stored["perr"],
        "constraint_rate": stored["verr"],
        "length": stored["L"],
        "speed": stored["Ldot"],
        "force_per_tension": stored["Q"],
        "factors": np.stack([stored["fl"], stored["fv"], stored["fp"], stored["cosp"]], axis=-1),
        "acceleration_at_rest": stored["a0"],
        "acceleration_per_control": stored["A"],
        "reaction_at_rest": stored["R0"],
        "reaction_per_control": stored["AR"],
    }


def relative_difference(found: Array, expected: Array) -> float:
    """max |Δ| over the array / max |reference|, the worst state."""
    states = len(expected)
    difference = np.abs(found - expected).reshape(states, -1).max(axis=1)
    return float((difference / np.abs(expected).reshape(states, -1).max(axis=1)).max())


def greatest_difference(found: Array, expected: Array) -> float:
    return float(np.abs(found - expected).max())
