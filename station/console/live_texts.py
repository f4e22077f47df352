"""Sentences of the live page."""

from __future__ import annotations

import math
from collections.abc import Sequence

from station.live.published import LiveBest, LiveRecent, LiveScenario, LiveSetup, LiveUpdate

MUSCLES_NAMED = 4
NO_VALUES = (
    "No live values: they are computed while a motion of the wearer is recorded with enabled = true under [live] in "
    "the configuration. This page shows them as soon as they arrive."
)


def body_text(setup: LiveSetup) -> str:
    """Whose body is solved."""
    scaled = "scaled to the wearer" if setup.subject.is_scaled else "generic, not scaled to the wearer"
    return f"body: {setup.subject.name}, {scaled}"


def scenario_text(scenario: LiveScenario) -> str:
    """What is worn. Further rest lengths and cuffs go by their own names."""
    return {"slack": "slack cord", "rigid": "rigid cuffs", "worn": "as worn"}.get(scenario.name, scenario.name)


def share_text(share: float) -> str:
    """Effort as a share of that with a slack cord; a dash without a solution."""
    return f"{100 * share:.0f} %" if math.isfinite(share) else "–"


def recent_heading(recent: LiveRecent | None) -> str:
    if recent is None or not recent.cycles:
        return "over cycles: none yet"
    return "last cycle" if recent.cycles == 1 else f"last {recent.cycles} cycles"


def best_text(best: LiveBest | None) -> str:
    """The best rest length so far, with its standard deviation."""
    if best is None:
        return "best rest length: known after the first cycle of the arm"
    change = 100 * (1 - best.effort)
    effort = f"{abs(change):.0f} % {'less' if change >= 0 else 'more'} effort than with a slack cord"
    beyond = {-1: " or shorter", 1: " or longer"}.get(best.edge, "")
    spread = f" ± {best.sd_m:.2f}" if math.isfinite(best.sd_m) and not beyond else ""
    return f"best for this motion so far: {best.rest_length_m:.2f} m{spread}{beyond}, {effort}"


def rest_length_text(rest_length_m: float) -> str:
    return f"rest length of the cord: {rest_length_m:.3f} m" if math.isfinite(rest_length_m) else ""


def most_active(muscles: Sequence[str], activations: Sequence[float]) -> str:
    """The muscles with the largest activations."""
    known = [(level, name) for name, level in zip(muscles, activations, strict=True) if math.isfinite(level)]
    if not known:
        return "no activations in this frame"
    return "most active: " + ", ".join(
        f"{name.replace('_', ' ')} {100 * level:.0f} %" for level, name in sorted(known, reverse=True)[:MUSCLES_NAMED]
    )


def delivery_text(setup: LiveSetup, update: LiveUpdate | None, *, is_over: bool) -> str:
    """How many frames are solved and left out, and what this page did not get."""
    if update is None:
        return "waiting for the first frame"
    delivery = update.delivery
    parts = [f"{setup.trial}, ended"] if is_over else [setup.trial]
    parts += [
        f"{delivery.solved_hz:.0f} of {setup.frame_rate_hz:.0f} frames per second solved",
        f"{delivery.dropped_frames} frames left out",
        f"latency {1e3 * delivery.latency_s:.0f} ms",
    ]
    parts += [f"{delivery.not_shown} updates not shown"] if delivery.not_shown else []
    return " · ".join(part for part in parts if part)
