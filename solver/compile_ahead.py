"""Compile the kernels of an assessment before it needs them: `python -m solver.compile_ahead`.

The machine code is kept on disk (compiled.py), so this can be done once after an installation, or in a second process
while trials are recorded. If a process needs the kernels now, others compile with it, each beginning with another
share. stdout has one line of JSON per kernel: how many are ready, and how many there are.
"""

from __future__ import annotations

import json
import logging
import os
import sys
from collections.abc import Callable
from pathlib import Path

KERNELS = (
    ("solver.multibody.joints", "move_bodies"),
    ("solver.wrapping.wrapped_paths", "place_points"),
    ("solver.wrapping.wrapped_paths", "evaluate_wrapped_paths"),
    ("solver.functions.bezier", "evaluate_chain"),
    ("solver.multibody.mass_matrix", "mass_matrix_and_bias"),
    ("solver.multibody.mass_matrix", "fill_responses"),
    ("solver.redundancy.reduction", "eliminate"),
    ("solver.redundancy.frames", "solve_activations"),
    ("solver.inverse_kinematics.solve", "solve_postures"),
    ("solver.inverse_kinematics.linearise", "fill_linearised"),
    ("solver.stream.lag_window", "smooth_window"),
    ("solver.wrapping.wrapped_paths", "place_path_nodes"),
)
"""Modules and names of the kernels that an assessment and its drawings call, in order of use; a test finds a missing
one."""

COMPILER = logging.getLogger("solver.compiled")


def is_first_use() -> bool:
    """Whether no file of the first kernel is on disk; found by its name, without numba, which takes long to import.

    False where a wheel brought it, and where the folder of the package is read-only, because numba then keeps the
    files elsewhere.
    """
    module, kernel = KERNELS[0]
    if Path(__file__).with_name("kernels").joinpath(f"{module}.{kernel}.nbi").exists():
        return False
    *folders, name = module.split(".")
    files = f"{name}.{kernel}-*.nbi"
    chosen = os.environ.get("NUMBA_CACHE_DIR")
    if chosen:
        return os.access(chosen, os.W_OK) and not any(Path(chosen).glob(f"*/{files}"))
    package = Path(__file__).parents[1].joinpath(*folders)
    return os.access(package, os.W_OK) and not any(package.glob(f"__pycache__/{files}"))


def compile_ahead(report: Callable[[int, int], None], begin_with: str = "") -> None:
    """Compile what is not on disk yet, and load the rest; report(ready, all) before and after each kernel.

    begin_with: one of SHARES, which imports little before it compiles.
    """
    with CompilationCount(report):
        if begin_with:
            SHARES[begin_with]()
        from solver.kernel_calls import call_every_kernel  # imports as much as an assessment does

        call_every_kernel()
    report(count_ready(), len(KERNELS))


def shares(processors: int) -> tuple[str, ...]:
    """Shares for the other processes, if one that needs the kernels now begins with the first kernel itself."""
    return tuple(SHARES)[: max(1, processors - 1)]


def _compile_solving() -> None:
    """The muscle-redundancy problem, and then dynamics."""
    import numpy as np

    from solver.redundancy.problem import RedundancyProblem
    from solver.redundancy.sequence import solve_sequence

    one, equation, reaction = np.ones(1), np.ones((1, 1, 1)), np.zeros((1, 1, 6))
    problem = RedundancyProblem(
        one, 1.0, one, np.ones((2, 1)), equation, equation, one > 0, np.zeros((1, 6, 1)), reaction, np.eye(3)[None]
    )
    solve_sequence(problem, progress=lambda *_: None, workers=1)
    _compile_dynamics()


def _compile_paths() -> None:
    """Muscle paths in no frame, so that nothing places their points or bodies."""
    import numpy as np

    from solver.bundled import bundled_model
    from solver.multibody.body_tables import POSE
    from solver.muscle import allocate_results
    from solver.wrapping.path_tables import CHANGE, pack_paths
    from solver.wrapping.wrapped_paths import allocate_wrap, evaluate_wrapped_paths

    model = bundled_model()
    tables = pack_paths(model, tuple(muscle.path for muscle in model.muscles))
    no_pose, no_change, no_rate = np.empty((0, 0), POSE), np.empty((0, 0), CHANGE), np.empty((0, 0))
    results = allocate_results(tables, frames=0, coordinates=0)
    evaluate_wrapped_paths(tables, no_pose, no_change, no_rate, allocate_wrap(tables), results)


def _compile_dynamics() -> None:
    """Muscle curves, and equations of motion in no frame, so that nothing places the bodies."""
    import numpy as np

    from solver.bundled import bundled_model
    from solver.multibody.body_tables import POSE
    from solver.multibody.dynamics import equations_of_motion, response_to_loads
    from solver.multibody.postures import Postures
    from solver.muscle import muscle_forces

    model = bundled_model()
    muscle_forces(model, np.ones((1, len(model.muscles))), np.zeros((1, len(model.muscles))))
    bodies, no_coordinate = len(model.bodies), np.empty((0, len(model.coordinates)))
    no_pose, no_screw = np.empty((0, bodies), POSE), np.empty((*no_coordinate.shape, 6))
    equations = equations_of_motion(model, Postures(no_coordinate, no_coordinate, no_pose, no_screw, time=np.empty(0)))
    response_to_loads(equations, np.zeros((0, 1, bodies, 6)))


# None calls a kernel of another process's share, because it would wait until that is compiled.
SHARES = {"solving": _compile_solving, "paths": _compile_paths, "dynamics": _compile_dynamics}


def count_ready() -> int:
    """Number of KERNELS that this process has compiled or loaded."""
    loaded = (getattr(sys.modules.get(module), name, None) for module, name in KERNELS)
    return sum(bool(kernel.signatures) for kernel in loaded if kernel is not None)


class CompilationCount(logging.Handler):
    """Counts kernels in place of the warnings of compiled.py: report(ready, all) before and after each kernel."""

    def __init__(self, report: Callable[[int, int], None]) -> None:
        super().__init__()
        self._report = report

    def emit(self, record: logging.LogRecord) -> None:  # noqa: ARG002 (the event itself is enough)
        self._report(count_ready(), len(KERNELS))

    def __enter__(self) -> CompilationCount:
        COMPILER.addHandler(self)
        return self

    def __exit__(self, *_: object) -> None:
        COMPILER.removeHandler(self)


def print_count(ready: int, total: int) -> None:
    """Print the count, or end where kernels cannot be kept: no other process would have them."""
    from solver.compiled import keeps_code

    if not keeps_code():
        sys.exit(1)
    print(json.dumps({"ready": ready, "kernels": total}), flush=True)


if __name__ == "__main__":
    compile_ahead(print_count)
