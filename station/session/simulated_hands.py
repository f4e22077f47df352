"""What a person does at the bench, where the devices are simulated: the page's orders, carried out."""

from __future__ import annotations

from station.bench.simulation import SimulatedBench
from station.protocol import TrialSpec
from station.session.agenda import Agenda


class SimulatedHands:
    """Of one bench. Raises SimulationError where it refuses."""

    def __init__(self, bench: SimulatedBench, pause_s: float) -> None:
        self._bench, self._pause_s = bench, pause_s
        self._prepared: TrialSpec | None = None

    def prepare(self, plan: Agenda) -> None:
        """Before the next trial: don its cuff, or let the wearer rest, and set the trial up."""
        spec = plan.spec
        if spec is None:
            return
        if plan.is_new_cuff:
            self._bench.tell({"don": spec.cuff})
        elif plan.has_pause and self._prepared != spec:
            self._bench.tell({"pause_s": self._pause_s})
        self._prepared = spec
        self._bench.tell({"trial": {"cuff": spec.cuff, "test": spec.test}})
