"""What a person does at the bench, where the devices are simulated: the page's orders, carried out."""

from __future__ import annotations

import threading
from contextlib import suppress

from station.bench.simulation import SimulatedBench, SimulationError
from station.protocol import TrialSpec
from station.session.agenda import Agenda
from station.session.guide import Cue


class SimulatedHands:
    """Of one bench; prepare() raises SimulationError where it refuses."""

    def __init__(self, bench: SimulatedBench, pause_s: float) -> None:
        self._bench, self._pause_s = bench, pause_s
        self._prepared: TrialSpec | None = None
        self._step = 0
        self._turn = threading.Lock()

    def prepare(self, plan: Agenda) -> None:
        """Before the next trial: don its cuff, or let the wearer rest, and set the trial up; takes its time."""
        with self._turn:
            self._prepare(plan)

    def is_behind(self, cue: Cue) -> bool:
        """Whether the page asks for more than it did when the hands followed last."""
        return cue.step > self._step

    def follow(self, cue: Cue) -> None:
        """Do what the page asks for, in the trial that is recorded; a bench that has ended does nothing more."""
        with self._turn, suppress(SimulationError):
            if self.is_behind(cue):
                self._step = cue.step
                self._bench.tell({"step": cue.step})

    def _prepare(self, plan: Agenda) -> None:
        spec = plan.spec
        if spec is None:
            return
        if plan.is_new_cuff:
            self._bench.tell({"don": spec.cuff})
        elif plan.has_pause and self._prepared != spec:
            self._bench.tell({"pause_s": self._pause_s})
        self._prepared, self._step = spec, 0
        self._bench.tell({"trial": {"cuff": spec.cuff, "test": spec.test}})
