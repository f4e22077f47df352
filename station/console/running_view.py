"""The running trial: what to do now, what is measured, how old that is, and that everything is alive."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Callable, Sequence
from typing import Any

from nicegui import background_tasks, ui

from station.console.actions import Actions
from station.console.charts import (
    DISPLACEMENT,
    DISPLACEMENT_AXIS,
    FORCE,
    FORCE_AXIS,
    TIME_AXIS,
    axis,
    axis_below,
    force_over_displacement,
    line,
)
from station.console.mark_receipt import MarkReceipt
from station.session.desk import Desk
from station.session.guide import Rest
from station.session.live import Live

SHOWN_S = 20.0
"""Of each curve over time."""
DRAW_TIMEOUT_S = 10.0
UNDRAWN_PICTURES = 2
"""Updates on their way to a browser; it is sent no more until it has drawn one, so that it is never far behind."""
HIGH_LOAD = 0.8
"""Of the ceiling."""
WORDS = {"idle": "opening the devices", "armed": "armed: start the capture", "closing": "closing"}
COLOURS = {
    Rest.WAITING: "grey-8",
    Rest.MOVING: "negative",
    Rest.SETTLING: "warning",
    Rest.STEADY: "positive",
    Rest.SWINGING: "positive",
}


def show(desk: Desk, live: Live, actions: Actions) -> Callable[[], None]:
    """Returns what keeps the picture up to date, to be called more than ten times a second."""
    stages = _stages(live)
    with ui.element("div").classes("slot w-full") as slot:
        cue = ui.label().classes("cue").mark("cue")
    figures = _Figures(desk, live)
    pictures = _Pictures(desk, live)
    receipt = MarkReceipt(desk, live, actions)
    status = ui.label().classes("status quiet whitespace-pre-line").mark("status")
    actions.add("Stop", "s", desk.runner.stop, kind="danger")
    actions.add("Mark", "m", receipt.mark, kind="main")
    actions.add("Tare", "z", desk.runner.tare)
    quiet = actions.add("I have seen it", "i", desk.runner.silence, kind="danger", mark="alarm-seen")
    actions.add("End the session", "e", lambda: _confirm_end(desk, actions), mark="end-early", is_apart=True)

    def tick() -> None:
        alarm, is_unseen = live.alarm, live.unseen_alarm is not None
        cue.text = alarm if alarm is not None and is_unseen else cue_of(live)
        slot.classes(add="alarm" if is_unseen else "", remove="" if is_unseen else "alarm")
        quiet.set_visibility(is_unseen)
        for number, stage in enumerate(stages):
            step = live.cue.step
            now = "done" if number < step else "current" if number == step else ""
            stage.classes(add=now, remove=" ".join({"done", "current"} - {now}))
        figures.tick()
        receipt.tick()
        status.text = status_of(live)
        pictures.tick()

    return tick


def _confirm_end(desk: Desk, actions: Actions) -> None:
    """One key must not end a trial and the session with it."""

    def go_on() -> None:
        actions.form.clear()
        actions.by_key.pop("y", None)

    go_on()
    with actions.form, ui.row().classes("items-center gap-3"):
        ui.label("End this trial now, and the session with what exists?").classes("text-xl doubtful")
        ui.button("Yes, end it (y)", on_click=lambda: actions.run(desk.runner.end_early)).props(
            "unelevated color=red-10"
        )
        ui.button("Go on (n)", on_click=go_on).props("outline")
    actions.by_key |= {"y": desk.runner.end_early, "n": go_on}


def cue_of(live: Live) -> str:
    """What is to be done now."""
    said = live.latest
    return live.cue.sentence if said["state"] == "recording" else WORDS.get(said["state"], str(said["sentence"]))


def state_of(said: dict[str, Any]) -> str:
    """The state with its time; of a recording also what speaks against it already."""
    if said["state"] == "armed":
        return f"armed for {said['waited_s']:.0f} s, {said['left_s']:.0f} s left"
    if said["state"] == "recording":
        return f"recording {said['recorded_s']:.1f} s{said['sentence'].removeprefix('recording')}"
    return str(said["sentence"])


def status_of(live: Live) -> str:
    """Two lines that are always there, so that nothing moves when one of their parts comes or goes."""
    said = live.latest
    level = said.get("sync_v")
    seen_alarm = [f"seen: {live.alarm}"] if live.alarm is not None and live.is_alarm_seen else []
    sync = f"sync line {level:z.2f} V" if level is not None else "sync line: nothing yet"
    first = [*seen_alarm, state_of(said), sync, markers_of(said.get("seen", {})), *list(live.words)[-1:]]
    return " · ".join(first) + "\n" + streams_of(said)


def streams_of(said: dict[str, Any]) -> str:
    rates = [
        f"{name[1:]} {stream['rate_hz']:.0f} of {stream['nominal_hz']:.0f}/s"
        for name, stream in sorted(said.get("streams", {}).items())
    ]
    rate, left = said.get("slow_rate"), said.get("disk_left_s")
    slow = [f"simulated bench runs at {rate:.2f} of real time"] if rate is not None else []
    disk = [f"disk for {left / 3600:.0f} h"] if left is not None else []
    behind = [f"page fell behind by {said['dropped']}"] if said.get("dropped") else []
    return " · ".join([*slow, f"lost {said.get('lost_samples', 0)}", *behind, *rates, *disk])


def markers_of(seen: dict[str, bool]) -> str:
    hidden = sorted(name for name, is_seen in seen.items() if not is_seen)
    if not seen:
        return "markers: no frames yet"
    return f"hidden: {', '.join(hidden)}" if hidden else f"all {len(seen)} markers seen"


def _stages(live: Live) -> list[ui.label]:
    """What is done, what is now, what is to come."""
    with ui.element("div").classes("stages").mark("stages"):
        return [ui.label(name).classes("stage") for name in live.guide.stages]


class _Figures:
    """Force with its load on the cell, displacement, the time left, and how far the body is from rest."""

    def __init__(self, desk: Desk, live: Live) -> None:
        self._live = live
        self._ceiling, self._capacity = desk.runner.ceilings.force_n, desk.runner.ceilings.capacity_n
        with ui.element("div").classes("figures"):
            with ui.column().classes("gap-1"):
                self._force = ui.label().classes("figure").mark("force")
                self._bar = ui.element("div").classes("load").mark("load")
                with self._bar:
                    self._level = ui.element("div")
                self._net = ui.label().classes("under").mark("net")
            with ui.column().classes("gap-1"):
                self._displacement = ui.label().classes("figure").mark("displacement")
                ui.label("displacement").classes("under")
            with ui.column().classes("gap-1"):
                self._left = ui.label().classes("figure").mark("left")
                self._left_words = ui.label().classes("under")
            self._rest = ui.badge("").classes("mt-3").mark("rest-state")

    def tick(self) -> None:
        live, now = self._live, self._live.cue
        force = live.force[-1][1] if live.force else None
        self._force.text = f"{force:z.1f} N" if force is not None else "\u2013 N"
        share = 0.0 if force is None else abs(force) / self._ceiling
        self._level.style(f"width: {100 * min(share, 1.0):.0f}%")
        grade = "over" if share > 1 else "high" if share > HIGH_LOAD else ""
        self._bar.classes(add=grade, remove=" ".join({"over", "high"} - {grade}))
        net = "no tare" if live.tare_n is None or force is None else f"net {force - live.tare_n:z.1f} N"
        self._net.text = f"{net} · ceiling {self._ceiling:.0f} N · cell {self._capacity:.0f} N"
        self._displacement.text = f"{live.displacement[-1][1]:+.1f} mm" if live.displacement else "\u2013 mm"
        has_left = live.latest["state"] == "recording" and now.left_s is not None
        self._left.text = f"{now.left_s:.0f} s" if has_left else ""
        action = "hold" if live.spec.test == "static" else "swing"
        self._left_words.text = f"still to {action}" if has_left else ""
        self._rest.text = now.rest.value
        self._rest.props(f'color="{COLOURS[now.rest]}"')


class _Pictures:
    """The curves and the markers. A browser is sent the next update when it has drawn the one before."""

    def __init__(self, desk: Desk, live: Live) -> None:
        self._live, self._client = live, ui.context.client
        self._on_their_way = 0
        self._drawn_at: float | None = None
        cuff = desk.session.config.cuffs.get(live.spec.cuff or "")
        named = {"anchor": cuff.anchor_markers, "cuff": cuff.cuff_markers, "rope": cuff.rope_markers} if cuff else {}
        self._roles = {label: role for role, labels in named.items() for label in labels}
        with ui.element("div").classes("charts"):
            self._over_time = ui.echart(_over_time()).mark("over-time")
            self._loop = ui.echart(force_over_displacement([])).mark("loop")
            self._markers = ui.element("canvas").classes("markers").props('aria-label="markers, drag to turn"')

    def tick(self) -> None:
        at = self._live.latest.get("at")
        if at is not None and at != self._drawn_at and self._on_their_way < UNDRAWN_PICTURES:
            self._drawn_at = at
            background_tasks.create(self._draw(at))

    async def _draw(self, at: float) -> None:
        live, said = self._live, self._live.latest
        points = [
            {"name": name, "role": self._roles.get(name, "other"), "at": point}
            for name, point in zip(said.get("seen", {}), said.get("points", []), strict=False)
        ]
        picture = {
            "at": at,
            "over_time": (self._over_time.id, [{"data": points} for points in curves_over_time(live)]),
            "loop": (self._loop.id, [{"data": _against(live)}]),
            "markers": (self._markers.html_id, points),
        }
        self._on_their_way += 1
        try:
            await self._client.run_javascript(f"return station.draw({json.dumps(picture)})", timeout=DRAW_TIMEOUT_S)
        except TimeoutError:  # a frozen or vanished browser; it says by itself how old its picture is
            await asyncio.sleep(0)
        finally:
            self._on_their_way -= 1


def curves_over_time(live: Live) -> list[list[tuple[float, float]]]:
    """Force and displacement of the last SHOWN_S, with their time from the sync edge."""
    return [_last(live.from_edge(points)) for points in (live.force, live.displacement)]


def _last(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    first = points[-1][0] - SHOWN_S if points else 0.0
    return [point for point in points if point[0] >= first][::2]


def _against(live: Live) -> list[list[float]]:
    """Force over displacement: each displacement with the force that came nearest to it in time."""
    force, pairs, at = list(live.force), [], 0
    for t, moved in list(live.displacement)[-600:][::2]:
        while at < len(force) - 1 and force[at][0] < t:
            at += 1
        if force:
            pairs.append([moved, force[at][1]])
    return pairs


def _over_time() -> dict[str, Any]:
    return {
        "animation": False,
        "grid": {"left": 60, "right": 60, "top": 40, "bottom": 60},
        "xAxis": axis_below(TIME_AXIS, splitNumber=5),
        "yAxis": [
            axis(FORCE_AXIS, FORCE),
            axis(DISPLACEMENT_AXIS, DISPLACEMENT, splitLine={"show": False}),
        ],
        "series": [line(FORCE), line(DISPLACEMENT, yAxisIndex=1)],
    }
