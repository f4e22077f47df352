"""What the fixture simulated_bench of cuffstation/pytest_plugin.py starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from drivers.simulators.simulated_bench import Bench


def bench_starter(running: ExitStack) -> Callable[..., Bench]:
    """A function of (speed, seed, faults, **settings) that starts a bench, which ends with the stack."""
    # Imported when asked for: physics and gRPC are slow to import.
    from drivers.simulators.faults import fault_from_dict
    from drivers.simulators.settings import settings_from_dict
    from drivers.simulators.simulated_bench import Bench

    def start(
        speed: float | None = None, seed: int = 0, faults: Sequence[dict[str, Any]] = (), **settings: Any
    ) -> Bench:
        plan = [fault_from_dict(fault) for fault in faults]
        return running.enter_context(Bench(settings_from_dict(settings), speed, seed, plan))

    return start
