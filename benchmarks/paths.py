"""Differences between the two path modes and their times: the figures of docs/paths.md.

    python benchmarks/paths.py

Over every motion of the public data set if it is beside the repository, else over the bundled arm raise; frames
filtered as for `station rmr`. Times are processor times on one core, after compilation.
"""

from __future__ import annotations

import sys
from itertools import pairwise
from pathlib import Path
from time import process_time

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
MODEL = DATA / "models" / "TSM_subject_noWeight.osim"
REPEATS = 7

sys.path.insert(0, str(ROOT))

from solver.bundled import bundled_model  # noqa: E402
from solver.model import Model  # noqa: E402
from solver.motion import differentiate, read_motion  # noqa: E402
from solver.multibody.postures import Postures, jacobians, postures, speeds_from_rates  # noqa: E402
from solver.osim.reader import read_osim  # noqa: E402
from solver.paths import PathMode, PathState, evaluate_paths  # noqa: E402
from solver.raise_arm import simulate_arm_raise  # noqa: E402

Array = NDArray[np.float64]


def main() -> None:
    model, coordinates, name = subject()
    state = postures(model, coordinates, np.zeros_like(coordinates))
    print(f"{name}: {len(coordinates)} frames, {len(model.muscles)} muscles")
    opensim_paths, geodesic = evaluate_paths(model, state), evaluate_paths(model, state, mode="geodesic")
    lengths = 1e3 * np.abs(geodesic.lengths - opensim_paths.lengths)
    arms = 1e3 * np.abs(moment_arms(model, state, geodesic) - moment_arms(model, state, opensim_paths)).max(axis=-1)
    print(f"{'':<26}   length [mm]       moment arm [mm]")
    print(f"{'muscle':<26}  median       max   median     max")
    for k, muscle in enumerate(model.muscles):
        if max(lengths[:, k].max(), arms[:, k].max()) > 1e-3:
            figures = [f(errors[:, k]) for errors in (lengths, arms) for f in (np.median, np.max)]
            print(f"{muscle.name:<26}" + "".join(f"{figure:9.4f}" for figure in figures))
    print(f"{'all':<26}" + "".join(f"{f(errors):9.4f}" for errors in (lengths, arms) for f in (np.median, np.max)))
    for mode, seconds in times(model, state).items():
        jump = jumps(model, coordinates, mode)
        print(f"{mode:<26}{1e6 * seconds / len(coordinates):9.1f} µs a frame, jumps of up to {jump:.0e} m")


def subject() -> tuple[Model, Array, str]:
    """Model, coordinates (frames, coordinates) and their description."""
    if not MODEL.exists():
        model = bundled_model()
        return model, differentiate(simulate_arm_raise(model)).positions, "bundled raise of the arm"
    model, files = read_osim(MODEL), sorted((DATA / "motions").glob("*.mot"))
    moved = [differentiate(read_motion(file, model)).positions for file in files]
    return model, np.concatenate(moved), ", ".join(file.stem for file in files)


def moment_arms(model: Model, state: Postures, paths: PathState) -> Array:
    """(frames, muscles, coordinates) generalised forces of a unit tension [m], the thorax's six in ground left out."""
    forces = np.einsum("fpbi,fbij->fpj", paths.wrench_per_tension, jacobians(model, state)) + paths.mobility_per_tension
    return forces[..., 6:]


def jumps(model: Model, coordinates: Array, mode: PathMode) -> float:
    """Largest change of a length [m] beyond the integral of its speed, in twenty steps between every fourth frame."""
    worst = 0.0
    for begin, end in pairwise(coordinates[::4]):
        if np.abs(end - begin).max() > 0.2:  # between two motions
            continue
        sweep = begin + np.linspace(0.0, 1.0, 21)[:, None] * (end - begin)
        rates = speeds_from_rates(model, sweep, np.tile((end - begin) / 20, (21, 1)))
        laid = evaluate_paths(model, postures(model, sweep, rates), mode=mode)
        expected = (laid.speeds[1:] + laid.speeds[:-1]) / 2
        worst = max(worst, float(np.abs(np.diff(laid.lengths, axis=0) - expected).max()))
    return worst


def times(model: Model, state: Postures) -> dict[PathMode, float]:
    """The shortest of several alternating runs of each mode [s]."""
    shortest: dict[PathMode, float] = {"opensim": np.inf, "geodesic": np.inf}
    for mode in tuple(shortest) * REPEATS:
        start = process_time()
        evaluate_paths(model, state, mode=mode)
        shortest[mode] = min(shortest[mode], process_time() - start)
    return shortest


if __name__ == "__main__":
    main()
