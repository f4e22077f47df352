"""Carries out the instructions of the guide at a simulated bench."""

from __future__ import annotations

import threading
from contextlib import suppress

from station.bench.simulation import SimulatedBench, SimulationError
from station.protocol import TrialSpec
from station.session.guide import Cue
from station.session.plan_status import PlanStatus


class SimulatedOperator:
    """Operates one bench; prepare() raises SimulationError if the bench refuses."""

    def __init__(self, bench: SimulatedBench, pause_s: float) -> None:
        self._bench, self._pause_s = bench, pause_s
        self._prepared: TrialSpec | None = None
        self._step = 0
        self._lock = threading.Lock()

    def prepare(self, plan: PlanStatus) -> None:
        """Prepare the next trial: don its cuff or rest, then select the trial. Blocks."""
        with self._lock:
            self._prepare(plan)

    def is_behind(self, cue: Cue) -> bool:
        """Whether the cue is a later step than the last one carried out."""
        return cue.step > self._step

    def follow(self, cue: Cue) -> None:
        """Carry out the cue of the running trial; without effect on a bench that has ended."""
        with self._lock, suppress(SimulationError):
            if self.is_behind(cue):
                self._step = cue.step
                self._bench.request({"step": cue.step})

    def _prepare(self, plan: PlanStatus) -> None:
        spec = plan.spec
        if spec is None:
            return
        self._bench.request({"capture": False})  # one that a killed recorder left; no trial runs now
        if plan.is_new_cuff:
            self._bench.request({"don": spec.cuff})
        elif plan.has_pause and self._prepared != spec:
            self._bench.request({"pause_s": self._pause_s})
        self._prepared, self._step = spec, 0
        self._bench.request({"trial": {"cuff": spec.cuff, "test": spec.test, "condition": spec.condition}})
