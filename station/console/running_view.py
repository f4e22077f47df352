"""The running trial: current instruction, measured values and their age, state of all streams, confirmation of a mark.

Flow control keeps a browser close to the trial, however slowly it draws.
"""

from __future__ import annotations

import json
from collections.abc import Awaitable, Callable, Collection, Sequence
from contextlib import suppress
from functools import partial
from typing import Any

from nicegui import background_tasks, ui

from station.bench.view import TrialTelemetry
from station.config import StationConfig
from station.console.actions import Actions
from station.console.charts import (
    DISPLACEMENT,
    DISPLACEMENT_AXIS,
    ELEVATION_AXIS,
    EMG_AXIS,
    EMG_OF_MVC_AXIS,
    FORCE,
    FORCE_AXIS,
    TIME_AXIS,
    axis,
    axis_below,
    emg_lines,
    force_over_motion,
    line,
    marks_at,
    zoomed_by_wheel,
)
from station.protocol import BODY_TESTS, TrialSpec
from station.session.controller import SessionController
from station.session.guide import RestState
from station.session.trial_runner import LiveTrial

SHOWN_S = 20.0
"""Seconds of each curve over time."""
DRAW_INTERVAL_S = 0.2
"""Curves and markers are drawn five times a second: half of the page's processor time is theirs."""
DRAW_TIMEOUT_S = 10.0
HIGH_LOAD = 0.8
"""Fraction of the force limit."""
STATE_TEXTS = {"idle": "opening the devices", "armed": "armed: start the capture", "closing": "closing"}
COLOURS = {
    RestState.WAITING: "grey-8",
    RestState.NO_ELEVATION: "grey-8",
    RestState.MOVING: "negative",
    RestState.SETTLING: "warning",
    RestState.STEADY: "positive",
    RestState.SWINGING: "positive",
}
UNDRAWN_UPDATES = 2
"""Updates sent to a browser and not drawn yet; more are sent only when one is drawn."""


def show(controller: SessionController, live: LiveTrial, actions: Actions) -> Callable[[], None]:
    """Returns a function that updates the view, to be called more than ten times a second."""
    stages = _stages(live, controller.session.minutes_left)
    with ui.element("div").classes("slot w-full") as slot:
        cue = ui.label().classes("cue").mark("cue")
    figures = _Readouts(controller, live)
    charts = _Charts(controller, live)
    receipt = MarkReceipt(controller, live, actions)
    status = ui.label().classes("status quiet whitespace-pre-line").mark("status")
    actions.add("Stop", "s", lambda: _stop(controller, live, actions), kind="danger", asks=True)
    actions.add("Mark", "m", receipt.mark, kind="main").classes("mark-button")
    if has_force(controller.session.config, live.spec):
        actions.add("Tare", "z", controller.runner.tare)
    pause = actions.add("Pause the charts", "p", _toggle_pause, mark="pause")
    pause.tooltip("the wheel zooms a chart, with Shift it scales it, a drag moves it, a double click shows all")
    silence = actions.add(
        "Silence the alarm", "i", controller.runner.acknowledge_alarm, kind="danger", mark="alarm-seen"
    )
    skip = partial(_skip_to_report, controller, actions)
    actions.add("Skip to report", "e", skip, mark="end-early", is_apart=True, asks=True)

    needed = marker_roles(controller.session.config, live.spec)

    def tick() -> None:
        alarm, is_unseen = live.alarm, live.unseen_alarm is not None
        cue.text = str(alarm) if alarm is not None and is_unseen else instruction_text(live)
        slot.classes(add="alarm" if is_unseen else "", remove="" if is_unseen else "alarm")
        silence.set_visibility(is_unseen)
        for number, stage in enumerate(stages):
            step = live.cue.step
            now = "done" if number < step else "current" if number == step else ""
            stage.classes(add=now, remove=" ".join({"done", "current"} - {now}))
        figures.tick()
        receipt.tick()
        status.text = status_text(live, needed)
        charts.tick()

    return tick


def _toggle_pause() -> None:
    ui.run_javascript("station.togglePause()")


async def _stop(controller: SessionController, live: LiveTrial, actions: Actions) -> None:
    """Cancel an armed trial at once; ask before a recording ends."""
    if live.latest.state != "recording":
        await controller.runner.stop()
        return
    question = "End this recording now? What is recorded so far is kept."
    actions.ask(question, ("End the recording", controller.runner.stop), "Continue the recording")


def _skip_to_report(controller: SessionController, actions: Actions) -> None:
    question = "End this trial now and skip to the report of the trials so far?"
    actions.ask(question, ("End the trial", controller.runner.end_early), "Continue the trial")


def instruction_text(live: LiveTrial) -> str:
    """The current instruction to the operator."""
    latest = live.latest
    if latest.state == "recording":
        return live.cue.sentence
    return STATE_TEXTS.get(latest.state, latest.sentence)


def guide_step(live: LiveTrial) -> tuple[str, int, str]:
    """State, step and code of the instruction: its figures may change without a new step."""
    cue = live.cue
    return live.latest.state, cue.step, cue.message.code.value


def state_text(telemetry: TrialTelemetry) -> str:
    """The state with its time, and the problems of a recording so far."""
    if telemetry.state == "armed":
        return f"armed for {telemetry.waited_s:.0f} s, {telemetry.left_s:.0f} s left"
    if telemetry.state == "recording":
        problems = f"; {telemetry.problems}" if telemetry.problems else ""
        return f"recording {telemetry.recorded_s:.1f} s{problems}"
    return telemetry.sentence


def status_text(live: LiveTrial, needed: Collection[str] = ()) -> str:
    """The state of the trial, and below it that of the streams; needed are the labels of the trial, empty for all."""
    latest = live.latest
    level = latest.sync_v
    seen_alarm = [f"seen: {live.alarm}"] if live.alarm is not None and live.is_alarm_seen else []
    sync = f"sync line {level:z.2f} V" if level is not None else "sync line: no sample yet"
    unread = [] if live.unread is None else [str(live.unread)]
    first = [*unread, *seen_alarm, state_text(latest), sync, markers_text(latest.seen, needed), *list(live.events)[-1:]]
    return " · ".join(first) + "\n" + " · ".join([*emg_text(live), streams_text(latest)])


def streams_text(telemetry: TrialTelemetry) -> str:
    rates = [
        f"{name[1:]} {stream.rate_hz:.0f} of {stream.nominal_hz:.0f}/s"
        for name, stream in sorted(telemetry.streams.items())
    ]
    rate, left = telemetry.slow_rate, telemetry.disk_left_s
    slow = [f"simulated bench runs at {rate:.2f} of real time"] if rate is not None else []
    disk = [f"disk for {left / 3600:.0f} h"] if left is not None else []
    dropped = [f"items not shown: {telemetry.dropped}"] if telemetry.dropped else []
    return " · ".join([*slow, f"lost {telemetry.lost_samples}", *dropped, *rates, *disk])


def markers_text(seen: dict[str, bool], needed: Collection[str] = ()) -> str:
    """Hidden markers of those that are needed; the others of the capture may belong to another trial."""
    if not seen:
        return "markers: no frames yet"
    wanted = [name for name in seen if name in needed] or list(seen)
    hidden = sorted(name for name in wanted if not seen[name])
    if hidden:
        return f"hidden: {', '.join(hidden)}"
    return f"marker {wanted[0]} seen" if len(wanted) == 1 else f"all {len(wanted)} markers seen"


def motion_text(live: LiveTrial) -> str:
    """The last displacement of the cuff, or elevation of the arm."""
    if live.is_of_wearer:
        return f"{live.motion[-1][1]:.0f} deg" if live.motion else "\u2013 deg"
    return f"{live.motion[-1][1]:+.1f} mm" if live.motion else "\u2013 mm"


def motion_axis(live: LiveTrial) -> str:
    return ELEVATION_AXIS if live.is_of_wearer else DISPLACEMENT_AXIS


def emg_axis(live: LiveTrial) -> str:
    return EMG_OF_MVC_AXIS if live.mvc_uv else EMG_AXIS


def emg_text(live: LiveTrial) -> list[str]:
    """The last EMG of every channel; empty without EMG."""
    last = ", ".join(f"{channel} {points[-1][1]:.0f}" for channel, points in live.shown_emg.items())
    return [f"{emg_axis(live)} {last}"] if last else []


def marker_roles(config: StationConfig, spec: TrialSpec) -> dict[str, str]:
    """Label of a marker → its role in the trial, for the colours of the view."""
    cuff, body = config.cuffs.get(spec.cuff or ""), config.body
    named: dict[str, tuple[str, ...]] = {}
    if cuff is not None:
        named = {"anchor": cuff.anchor_markers, "cuff": cuff.cuff_markers, "rope": cuff.rope_markers}
    elif spec.test in BODY_TESTS and body is not None:
        worn = body.markers_in(spec.condition)
        named = {"body": worn.body, "suit": worn.suit, "arm": worn.arm}
    elif spec.test == "bounce" and config.bounce is not None:
        named = {"cuff": (config.bounce.marker,)}
    return {label: role for role, labels in named.items() for label in labels}


def _stages(live: LiveTrial, minutes_left: int) -> list[ui.label]:
    """Steps of the trial: done, current, to come; at the end of their line, the time left of the session."""
    with ui.element("div").classes("stages").mark("stages"):
        stages = [ui.label(name).classes("stage") for name in live.guide.stages]
        ui.label(f"about {minutes_left} min left").classes("time-left quiet")
    return stages


class _Readouts:
    """Force with a bar of its limit, displacement or elevation, the time left, and how steady it is."""

    def __init__(self, controller: SessionController, live: LiveTrial) -> None:
        self._live = live
        self._limit, self._capacity = controller.runner.limits.force_n, controller.runner.limits.capacity_n
        with ui.element("div").classes("figures"):
            with ui.column().classes("gap-1") as force:
                self._force = ui.label().classes("figure").mark("force")
                self._bar = ui.element("div").classes("load").mark("load")
                with self._bar:
                    self._level = ui.element("div")
                self._net = ui.label().classes("under").mark("net")
            force.set_visibility(has_force(controller.session.config, live.spec))
            with ui.column().classes("gap-1"):
                self._motion = ui.label().classes("figure").mark("displacement")
                ui.label("elevation" if live.is_of_wearer else "displacement").classes("under")
            with ui.column().classes("gap-1"):
                self._left = ui.label().classes("figure").mark("left")
                self._left_unit = ui.label().classes("under")
            self._rest = ui.badge("").classes("mt-3").mark("rest-state")
            self._rest.set_visibility(live.spec.test != "motion")  # a moving arm is no fault there

    def tick(self) -> None:
        live, now = self._live, self._live.cue
        force = live.force[-1][1] if live.force else None
        self._force.text = f"{force:z.1f} N" if force is not None else "\u2013 N"
        share = 0.0 if force is None else abs(force) / self._limit
        self._level.style(f"width: {100 * min(share, 1.0):.0f}%")
        grade = "over" if share > 1 else "high" if share > HIGH_LOAD else ""
        self._bar.classes(add=grade, remove=" ".join({"over", "high"} - {grade}))
        net = "not tared" if live.tare_n is None or force is None else f"net {force - live.tare_n:z.1f} N"
        self._net.text = f"{net} · limit {self._limit:.0f} N · cell {self._capacity:.0f} N"
        self._motion.text = motion_text(live)
        has_left = live.latest.state == "recording" and now.left_s is not None
        self._left.text = f"{now.left_s:.0f} s" if has_left else ""
        action = "hold" if live.spec.test in ("static", "pose") else "swing"
        self._left_unit.text = f"left to {action}" if has_left else ""
        self._rest.text = now.rest.value
        self._rest.props(f'color="{COLOURS[now.rest]}"')


class _Charts:
    """The curves and the markers."""

    def __init__(self, controller: SessionController, live: LiveTrial) -> None:
        self._live, self._client = live, ui.context.client
        self._sender = UpdateSender(self._draw)
        self._roles = marker_roles(controller.session.config, live.spec)
        motion, self._has_force = motion_axis(live), has_force(controller.session.config, live.spec)
        has_emg = live.is_of_wearer and controller.session.config.emg is not None
        self._emg: ui.echart | None = None
        self._loop: ui.echart | None = None
        with ui.element("div").classes("charts" if self._has_force or has_emg else "charts two"):
            chart = _over_time(motion) if self._has_force else _motion_over_time(motion)
            self._over_time = ui.echart(chart).mark("over-time")
            if has_emg:
                self._emg = ui.echart(_emg_over_time(live)).mark("emg")
            elif self._has_force:
                self._loop = ui.echart(force_over_motion([], motion)).mark("loop")
            self._markers = ui.element("canvas").classes("markers").props('aria-label="markers, drag to turn"')

    def tick(self) -> None:
        at = self._live.latest.at
        self._sender.tick(None if at is None else int(at / DRAW_INTERVAL_S))

    async def _draw(self) -> None:
        latest = self._live.latest
        points = [
            {"name": name, "role": self._roles.get(name, "other"), "at": point}
            for name, point in zip(latest.seen, latest.points, strict=False)
            if name in self._roles or self._live.spec.test != "bounce"  # a bounce shows its own marker
        ]
        update = {"at": latest.at, "charts": self._curves(), "markers": (self._markers.html_id, points)}
        await self._client.run_javascript(f"return station.draw({json.dumps(update)})", timeout=DRAW_TIMEOUT_S)

    def _curves(self) -> list[tuple[int, list[dict[str, Any]]]]:
        """Id of each chart and its series."""
        curves = curves_over_time(self._live)
        marked = {"markLine": marks_at(self._live.marks, self._live.mark_names)}
        shown = curves if self._has_force else curves[1:]
        drawn: list[tuple[int, list[dict[str, Any]]]] = [
            (self._over_time.id, [{"data": shown[0], **marked}, *({"data": curve} for curve in shown[1:])])
        ]
        if self._emg is not None:
            drawn.append((self._emg.id, emg_lines(emg_over_time(self._live))))
        if self._loop is not None:
            drawn.append((self._loop.id, [{"data": _force_over_motion(self._live)}]))
        return drawn


def has_force(config: StationConfig, spec: TrialSpec) -> bool:
    """Whether the load cell measures anything: in the trials of the wearer only the force of the cord."""
    if spec.test not in BODY_TESTS:
        return True
    return config.body is not None and config.body.markers_in(spec.condition).is_cord_measured


def curves_over_time(live: LiveTrial) -> list[list[tuple[float, float]]]:
    """Force, and displacement or elevation, of the last SHOWN_S, with their time from the sync edge."""
    return [_last(live.from_edge(points)) for points in (live.force, live.motion)]


def emg_over_time(live: LiveTrial) -> dict[str, list[tuple[float, float]]]:
    """RMS of every channel in the last SHOWN_S, with its time from the sync edge."""
    return {channel: _last(live.from_edge(points)) for channel, points in live.shown_emg.items()}


def _last(points: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    first = points[-1][0] - SHOWN_S if points else 0.0
    return [point for point in points if point[0] >= first][::2]


def _force_over_motion(live: LiveTrial) -> list[list[float]]:
    """Points (displacement or elevation, force), with the force at the next force sample."""
    force, pairs, at = list(live.force), [], 0
    for t, motion in list(live.motion)[-600:][::2]:
        while at < len(force) - 1 and force[at][0] < t:
            at += 1
        if force:
            pairs.append([motion, force[at][1]])
    return pairs


def _over_time(motion: str) -> dict[str, Any]:
    """Chart of the force and, on the right axis, of the motion of that name."""
    right = axis(motion, DISPLACEMENT, splitLine={"show": False})
    return {
        "animation": False,
        "grid": {"left": 60, "right": 60, "top": 40, "bottom": 60},
        "xAxis": axis_below(TIME_AXIS, splitNumber=5),
        "yAxis": [axis(FORCE_AXIS, FORCE), right],
        "dataZoom": _zoom([0, 1]),
        "series": [line(FORCE), line(DISPLACEMENT, yAxisIndex=1)],
    }


def _motion_over_time(motion: str) -> dict[str, Any]:
    """Chart of the motion of that name alone."""
    chart = _over_time(motion)
    return {**chart, "yAxis": [axis(motion, DISPLACEMENT)], "dataZoom": _zoom([0]), "series": [line(DISPLACEMENT)]}


def _zoom(vertical: list[int]) -> list[dict[str, Any]]:
    """The wheel zooms the time axis, with Shift the vertical axes of these numbers."""
    return [zoomed_by_wheel(xAxisIndex=0), zoomed_by_wheel(yAxisIndex=vertical, zoomOnMouseWheel="shift")]


def _emg_over_time(live: LiveTrial) -> dict[str, Any]:
    """Chart of the EMG; its channels are named by the first samples."""
    grid = {"left": 60, "right": 20, "top": 70, "bottom": 60}
    legend = {"top": 0, "right": 10, "type": "scroll", "textStyle": {"fontSize": 16}}
    axes = {"xAxis": axis_below(TIME_AXIS, splitNumber=4), "yAxis": axis(emg_axis(live))}
    return {"animation": False, "grid": grid, "legend": legend, **axes, "dataZoom": _zoom([0]), "series": []}


class MarkReceipt:
    """One line under the curves, with a field to name this page's last mark. Enter stores the name, Escape leaves the
    field. The browser clears the field and moves the focus to it (freshness.js): after a round trip to the console,
    keys typed in between would act as commands, and the beginning of the name would be lost.
    """

    def __init__(self, controller: SessionController, live: LiveTrial, actions: Actions) -> None:
        self._controller, self._live, self._run = controller, live, actions.run
        self._number = 0
        with ui.element("div").classes("receipt"):
            self._text = ui.label("no mark yet").classes("quiet").mark("receipt")
            self._note = ui.input(placeholder="name, then Enter").props("dense outlined")
            self._note.classes("grow note").mark("note")
            self._note.on("keydown.enter", self._store_name)

    async def mark(self) -> None:
        """Mark this moment. An alarm or another page may add marks before this one is named."""
        self._number = 0
        self._number = await self._controller.runner.mark()

    async def _store_name(self) -> None:
        name = str(self._note.value or "")
        await self._run(lambda: self._controller.runner.name_mark(self._number, name))
        self._note.value = ""
        self._note.run_method("blur")

    def tick(self) -> None:
        marks = self._live.marks
        if not marks:
            return
        number = max(marks)
        is_recorded = self._live.latest.marks >= number
        name = self._live.mark_names.get(number, "")
        stored = "in the recording" if is_recorded else "sent to the recorder"
        self._text.text = f"mark {number} at {marks[number]:.1f} s is {stored}" + (f": {name}" if name else "")


class UpdateSender:
    """Sends the newest data to one browser.

    draw sends an update and returns when the browser has drawn it; TimeoutError: it has not, frozen or closed.
    """

    def __init__(self, draw: Callable[[], Awaitable[object]]) -> None:
        self._draw = draw
        self._undrawn = 0
        self._sent: object = None

    def tick(self, data: object) -> None:
        """Send the data, given by themselves or by their time, unless they are sent or the browser is behind."""
        if data is not None and data != self._sent and self._undrawn < UNDRAWN_UPDATES:
            self._sent = data
            self._undrawn += 1
            background_tasks.create(self._send())

    async def _send(self) -> None:
        try:
            with suppress(TimeoutError):  # the page itself shows the age of its data
                await self._draw()
        finally:
            self._undrawn -= 1
