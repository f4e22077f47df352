"""Live values on a terminal: effort, cord force and joint force of every scenario, their age, and findings.

A replay prints frames by outcome, and mean effort and largest forces of every scenario.
"""

from __future__ import annotations

import math
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from documents.interval import counted
from solver.stream.stream_frame import StreamOutcome
from station.live.published import LiveDelivery, LiveScenario, LiveSetup, LiveUpdate, LiveValues
from station.live.subscription import LiveSubscription

REFRESH_S = 0.1
Array = NDArray[np.float64]


def watch(subscription: LiveSubscription, console: Console) -> None:
    """Show the updates until the live process ends; on no terminal only the findings, once each."""
    latest: LiveUpdate | None = None
    shown: set[str] = set()
    with Live(console=console, refresh_per_second=1 / REFRESH_S, transient=True) as screen:
        while not subscription.wait_until_over(REFRESH_S):
            latest = ([latest, *subscription.take()])[-1]
            if latest is None:
                continue
            if console.is_terminal:
                screen.update(render(subscription.setup, latest, time.time()))
                continue
            for finding in latest.findings:
                if finding.code not in shown:
                    shown.add(finding.code)
                    console.print(finding.sentence, markup=False, highlight=False, soft_wrap=True)


def render(setup: LiveSetup, update: LiveUpdate, now_s: float) -> Group:
    """One update as a table with its age and findings."""
    body = setup.subject.name if setup.subject.is_scaled else f"{setup.subject.name}, generic"
    delivery = update.delivery
    age = delivery.age_at(now_s)
    table = Table(title=f"{setup.trial}   body: {body}   lag {1e3 * setup.lag_s:.0f} ms", title_justify="left")
    for heading in ("suit", "rest length", "effort", "last cycles", "cord force", "joint force"):
        table.add_column(heading, justify="left" if heading == "suit" else "right")
    if update.values is not None:
        for place, scenario in enumerate(update.scenarios or setup.scenarios):
            table.add_row(*_row(scenario, place, update.values))
    table.caption = (
        f"age {age:.2f} s, {delivery.solved_hz:.0f} frames/s, {counted(delivery.dropped_frames, 'frame')} left out"
        if math.isfinite(age)
        else "no values"
    )
    return Group(table, *(Text(finding.sentence) for finding in update.findings), *_remarks(update.values))


def _row(scenario: LiveScenario, place: int, values: LiveValues) -> tuple[str, ...]:
    solved = values.scenarios[place]
    slack = values.scenarios[0].effort
    recent = values.recent.effort[scenario.name] if values.recent else math.nan
    return (
        scenario.name,
        _figure(scenario.rest_length_m, "{:.3f} m"),
        _figure(100 * solved.effort / slack if slack else math.nan, "{:.0f} %"),
        _figure(100 * recent, "{:.0f} %"),
        _figure(solved.cord_force_n, "{:.0f} N"),
        _figure(float(np.linalg.norm(solved.joint_force_n)), "{:.0f} N"),
    )


def _remarks(values: LiveValues | None) -> list[Text]:
    remarks = []
    if values is not None and math.isfinite(values.cord_force_measured_n):
        remarks.append(Text(f"measured cord force {values.cord_force_measured_n:.0f} N, without the cell's zero"))
    if values is not None and values.best is not None:
        remarks.append(Text(best_sentence(values)))
    return remarks


def best_sentence(values: LiveValues) -> str:
    """The best rest length so far, with its standard deviation over the cycles."""
    best = values.best
    if best is None:
        return "no best rest length yet: it takes three rest lengths and a whole cycle of the arm"
    bound = {-1: "at most ", 0: "", 1: "at least "}[best.edge]
    spread = f" ± {best.sd_m:.2f}" if math.isfinite(best.sd_m) else ""
    less = 100 * (1 - best.effort)
    change = f"{abs(less):.0f} % {'less' if less >= 0 else 'more'} effort than slack"
    return f"best for this motion so far: {bound}{best.rest_length_m:.2f}{spread} m, {change}"


def _figure(value: float, form: str) -> str:
    return form.format(value) if math.isfinite(value) else "–"


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
