"""A live process of the tests: the arm raise of the bundled model with made-up activations, published as in earnest."""

import math
import time
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Self

import numpy as np

from solver.bundled import bundled_model, simulate_arm_raise
from solver.motion import differentiate
from station.live.published import (
    NAN,
    LiveBest,
    LiveDelivery,
    LiveFinding,
    LiveRecent,
    LiveScenario,
    LiveScenarioValues,
    LiveSetup,
    LiveSubject,
    LiveUpdate,
    LiveValues,
)
from station.live.subscription import LiveServer, announce, withdraw

MODEL = bundled_model()
SCENARIOS = (
    LiveScenario("slack", "slack", NAN),
    LiveScenario("worn", "both", 0.70, "hand"),
    LiveScenario("rigid", "rigid", 0.70),
    LiveScenario("0.680 m", "both", 0.68, "hand"),
)
SHARES = {"slack": 1.0, "worn": 0.91, "rigid": 0.88, "0.680 m": 0.93}
"""Effort by scenario, over that of the slack one."""


def live_setup(**changes: Any) -> LiveSetup:
    return replace(
        LiveSetup(
            trial="motion, suited, repeat 1",
            subject=LiveSubject("thoracoscapular", is_scaled=False),
            coordinates=MODEL.coordinate_names,
            muscles=MODEL.muscle_names,
            markers=("ij", "px"),
            scenarios=SCENARIOS,
            lag_s=0.15,
            frame_rate_hz=100.0,
            emg_channels=("deltoid", "biceps"),
            has_cord_cell=True,
            origin="simulated",
        ),
        **changes,
    )


@dataclass
class LiveSource:
    """A context manager. rest_lengths are those that views have asked for."""

    folder: Path
    setup: LiveSetup = field(default_factory=live_setup)
    findings: tuple[LiveFinding, ...] = ()
    rest_lengths: list[tuple[str, float]] = field(default_factory=list)
    frame: int = 0

    def __enter__(self) -> Self:
        self._scenarios = list(self.setup.scenarios)
        self._motion = differentiate(simulate_arm_raise(MODEL)).positions
        self._server = LiveServer(self.setup, self._command, rate_hz=1e6).__enter__()
        announce(self.folder, self._server.address)
        return self

    def __exit__(self, *_: object) -> None:
        withdraw(self.folder, self._server.address)
        self._server.__exit__(None, None, None)

    @property
    def views(self) -> int:
        return self._server.views

    def publish(self, *, age_s: float = 0.17) -> LiveValues:
        """The next frame, 0.04 s later."""
        values = self._values()
        self._send(values, age_s)
        return values

    def publish_nothing(self) -> None:
        """An update without values, as while nothing can be solved."""
        self._send(None, 0.17)

    def _send(self, values: LiveValues | None, age_s: float) -> None:
        self.frame += 1
        delivery = LiveDelivery(time.time(), age_s, age_s - self.setup.lag_s, self.frame, 0, 1, 100.0)
        self._server.publish(LiveUpdate(values, delivery, self.findings, tuple(self._scenarios)))

    def _values(self) -> LiveValues:
        rise = 0.5 - 0.5 * math.cos(2 * math.pi * self.frame / 100)
        at = round(rise * 0.45 * len(self._motion))
        base = 0.02 + 0.8 * rise * np.random.default_rng(3).beta(0.6, 2.0, len(self.setup.muscles))
        shares = {one.name: SHARES[one.name] for one in self.setup.scenarios}
        no_force = (NAN, NAN, NAN)
        scenarios = tuple(
            LiveScenarioValues(
                "solved", 2 * rise * share, 0.0, tuple((share * base).tolist()), 90 * rise * (name != "slack"), no_force
            )
            for name, share in shares.items()
        )
        cycles = self.frame // 100
        return LiveValues(
            time_s=0.04 * self.frame,
            frame=4 * self.frame,
            outcome="solved",
            coordinates=tuple(self._motion[at].tolist()),
            speeds=(),
            accelerations=(),
            scenarios=scenarios,
            cord_force_measured_n=85 * rise,
            emg_rms_uv=(20 + 180 * rise, 15 + 40 * rise),
            recent=LiveRecent(cycles, shares) if cycles else None,
            best=LiveBest(0.71, 0.01, 0.91, cycles) if cycles else None,
        )

    def _command(self, command: dict[str, Any]) -> None:
        name, rest_length_m = str(command["scenario"]), float(command["rest_length_m"])
        self.rest_lengths.append((name, rest_length_m))
        self._scenarios = [
            replace(one, rest_length_m=rest_length_m) if one.name == name else one for one in self._scenarios
        ]
