"""What a replay prints: frames by outcome, and mean effort and largest forces of every scenario."""

from __future__ import annotations

import math
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from solver.stream.stream_frame import StreamOutcome
from station.live.published import LiveDelivery, LiveSetup, LiveValues
from station.live.terminal_view import best_sentence

Array = NDArray[np.float64]


class LiveSummary:
    """A sink. Means are over the frames in which every scenario is solved."""

    def __init__(self) -> None:
        self._setup: LiveSetup | None = None
        self._outcomes: Counter[str] = Counter()
        self._rows: list[tuple[tuple[float, float, float], ...]] = []
        self._last: LiveValues | None = None

    def begin(self, setup: LiveSetup) -> None:
        self._setup = setup

    def begin_recording(self, recording: Path) -> None: ...

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:  # noqa: ARG002
        self._outcomes[str(values.outcome)] += 1
        self._last = values
        rows = ((one.effort, one.cord_force_n, float(np.linalg.norm(one.joint_force_n))) for one in values.scenarios)
        self._rows.append(tuple(rows))

    def note(self, kind: str, text: str) -> None: ...

    @property
    def is_whole(self) -> bool:
        """Whether all frames have a posture of their own markers, and muscles."""
        return set(self._outcomes) == {StreamOutcome.SOLVED.value} and len(self._solved) == len(self._rows)

    def to_plain(self) -> dict[str, Any]:
        """As JSON; efforts are over that of the slack suit."""
        best = self._last.best if self._last else None
        return {
            "body": self._setup.subject.name if self._setup else None,
            "is_scaled": self._setup.subject.is_scaled if self._setup else None,
            "frames": dict(self._outcomes),
            "scenarios": self._scenarios(),
            "best_rest_length_m": None if best is None else best.rest_length_m,
            "best_rest_length_edge": None if best is None else best.edge,
        }

    def lines(self) -> list[str]:
        frames = ", ".join(f"{count} {outcome}" for outcome, count in self._outcomes.items()) or "none"
        lines = [f"frames: {frames}"]
        lines += [
            f"{row['name']}: effort {100 * row['effort']:.0f} %, cord force up to {row['cord_force_n']:.0f} N, "
            f"joint force up to {row['joint_force_n']:.0f} N"
            for row in self._scenarios()
        ]
        return [*lines, best_sentence(self._last)] if self._last is not None else lines

    @property
    def _solved(self) -> Array:
        rows = np.array(self._rows)
        return rows[np.isfinite(rows[..., 0]).all(axis=1)] if len(rows) else np.zeros((0, 0, 3))

    def _scenarios(self) -> list[dict[str, Any]]:
        solved = self._solved
        if self._setup is None or not len(solved):
            return []
        mean, most = solved[:, :, 0].mean(axis=0), np.nanmax(solved, axis=0)
        return [
            {
                "name": scenario.name,
                "rest_length_m": scenario.rest_length_m if math.isfinite(scenario.rest_length_m) else None,
                "effort": float(mean[place] / mean[0]),
                "cord_force_n": float(most[place, 1]),
                "joint_force_n": float(most[place, 2]),
            }
            for place, scenario in enumerate(self._setup.scenarios)
        ]
