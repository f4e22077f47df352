"""Small plans for tests: a few frames of the bundled motion, published cuffs."""

from __future__ import annotations

import json
from pathlib import Path

CUFFS = {
    "waist": (2140.0, 124.0, 0.012),
    "hand": (8520.0, 210.0, 0.012),
    "elbow": (2530.0, 139.0, 0.022),
}
KEYS = ("stiffness_n_per_m", "damping_n_s_per_m", "migration_m")
CUFF = 'cuff = ["hand", "elbow"]\n'


def write_plan(folder: Path, vary: str = "", head: str = "every = 60\n") -> Path:
    """plan.toml beside a cuffs.json; vary goes into its table of that name."""
    cuffs = {name: dict(zip(KEYS, values, strict=True)) for name, values in CUFFS.items()}
    (folder / "cuffs.json").write_text(json.dumps({"cuffs": cuffs}), encoding="utf-8")
    path = folder / "plan.toml"
    cuff = "" if "cuff = " in vary else CUFF
    path.write_text(f'{head}[vary]\ncuffs = "cuffs.json"\n{cuff}{vary}', encoding="utf-8")
    return path
