"""Live values on a terminal: effort, cord force and joint force of every scenario, their age, and findings."""

from __future__ import annotations

import math
import time

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from station.live.published import LiveScenario, LiveSetup, LiveUpdate, LiveValues
from station.live.subscription import LiveSubscription

REFRESH_S = 0.1


def watch(subscription: LiveSubscription, console: Console) -> None:
    """Show the updates until the live process ends; on no terminal only the findings, once each."""
    latest: LiveUpdate | None = None
    told: set[str] = set()
    with Live(console=console, refresh_per_second=1 / REFRESH_S, transient=True) as screen:
        while not subscription.wait_until_over(REFRESH_S):
            latest = ([latest, *subscription.take()])[-1]
            if latest is None:
                continue
            if console.is_terminal:
                screen.update(render(subscription.setup, latest, time.time()))
                continue
            for finding in latest.findings:
                if finding.code not in told:
                    told.add(finding.code)
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
        f"age {age:.2f} s, {delivery.solved_hz:.0f} frames/s, {delivery.dropped_frames} frames left out"
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
