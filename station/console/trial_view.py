"""The trial: what comes next, and while it runs what to do now and that everything is alive."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from nicegui import ui

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
from station.session.agenda import Agenda, order_of
from station.session.desk import Desk
from station.session.guide import Rest
from station.session.live import Live

Acts = dict[str, Callable[[], Awaitable[None] | None]]
SHOWN_S = 20.0
"""Of each curve over time."""
SHOWN_WORDS = 2
"""Lines of what devices say; all of it is in the recording."""
WORDS = {"idle": "opening the devices", "armed": "armed: start the capture", "closing": "closing"}
COLOURS = {
    Rest.WAITING: "grey-8",
    Rest.MOVING: "negative",
    Rest.SETTLING: "warning",
    Rest.STEADY: "positive",
    Rest.SWINGING: "positive",
}


def show_next(desk: Desk, plan: Agenda, act: Callable[..., Any], acts: Acts) -> None:
    spec = plan.spec
    assert spec is not None  # noqa: S101  (the page shows the summary then)
    ui.label(order_of(plan, desk.config.protocol.pause_s)).classes("cue").mark("order")
    of_cuff = "bounce calibration" if spec.cuff is None else f"{spec.cuff}: {spec.test}, repeat {spec.repeat}"
    ui.label(f"next: {of_cuff}").classes("text-3xl").mark("next")
    if plan.has_pause:
        _rest(desk)
    acts["arm"] = desk.arm
    with ui.row():
        ui.button("Arm (a)", on_click=lambda: act(desk.arm)).mark("arm")
        ui.button("Leave the session", on_click=lambda: act(desk.leave)).props("outline").mark("leave")
    ui.linear_progress(len(plan.done) / len(plan.trials), show_value=False).classes("w-full")
    with ui.row().classes("gap-2"):
        for each in plan.trials:
            name = "bounce" if each.cuff is None else f"{each.cuff} {each.test} {each.repeat}"
            is_done = each in plan.done
            ui.chip(name, icon="check" if is_done else None, color="positive" if is_done else "grey-8").props("dark")


def slow_of(said: dict[str, Any]) -> str:
    """Where a simulated bench does not keep its pace on this machine."""
    rate = said.get("slow_rate")
    return f"simulated bench runs at {rate:.2f} of real time" if rate is not None else ""


def _rest(desk: Desk) -> None:
    """Counts down; nobody is kept from arming earlier, a wearer may have rested already."""
    left = ui.label().classes("figure").mark("rest")

    def count() -> None:
        seconds = desk.rest_left_s
        left.text = f"{seconds:.0f} s" if seconds > 0 else "rested"

    ui.timer(0.5, count)


def show_running(desk: Desk, live: Live, act: Callable[..., Any], acts: Acts) -> Callable[[], None]:
    """Returns what keeps the picture up to date, to be called more than ten times a second."""
    alarm = ui.label().classes("alarm w-full p-6 rounded").mark("alarm")
    alarm_seen = ui.label().classes("text-3xl text-negative").mark("alarm-seen")
    cue = ui.label().classes("cue").mark("cue")
    with ui.row().classes("w-full items-center gap-x-10 gap-y-2"):
        force, displacement, left = _figure("force"), _figure("displacement"), _figure("left")
        rest = ui.badge("").mark("rest-state")
    with ui.row().classes("items-center gap-x-6 gap-y-2"):
        ui.button("Stop (s)", color="negative", on_click=lambda: act(desk.stop)).mark("stop")
        ui.button("Mark (m)", on_click=lambda: act(desk.mark)).props("outline").mark("mark")
        quiet = ui.button("I have seen it (i)", on_click=lambda: act(desk.silence)).props("outline color=negative")
        state = ui.label().classes("text-2xl").mark("state")
        sync = ui.label().classes("text-2xl").mark("sync")
    acts |= {"stop": desk.stop, "mark": desk.mark, "silence": desk.silence}
    with ui.row().classes("w-full no-wrap gap-4"):
        over_time = ui.echart(_over_time()).classes("w-2/3 h-64").mark("over-time")
        loop = ui.echart(force_over_displacement([])).classes("w-1/3 h-64").mark("loop")
    streams = ui.label().classes("text-2xl").mark("streams")
    markers = ui.label().classes("text-2xl").mark("markers")
    slow = ui.label().classes("text-2xl text-warning").mark("slow")
    words = ui.label().classes("text-xl opacity-80 whitespace-pre-line")

    def tick() -> None:
        said, now = live.latest, live.cue
        recording = said["state"] == "recording"
        alarm.text = alarm_seen.text = live.alarm or ""
        for element in (alarm, quiet):
            element.set_visibility(live.unseen_alarm is not None)
        alarm_seen.set_visibility(live.is_alarm_seen)
        cue.text = cue_of(live)
        force.text = f"{live.force[-1][1]:.1f} N" if live.force else "- N"
        displacement.text = f"{live.displacement[-1][1]:+.1f} mm" if live.displacement else "- mm"
        left.text = f"{now.left_s:.0f} s" if recording and now.left_s is not None else ""
        rest.text, rest.props["color"] = now.rest.value, COLOURS[now.rest]
        rest.update()
        state.text = state_of(said)
        level = said.get("sync_v")
        sync.text = f"sync line {level:.2f} V" if level is not None else "sync line: nothing yet"
        streams.text = _streams(said)
        markers.text = _markers(said.get("seen", {}))
        slow.text = slow_of(said)
        slow.set_visibility(bool(slow.text))
        words.text = "\n".join(list(live.words)[-SHOWN_WORDS:])
        curves = [_last(live.from_edge(curve)) for curve in (live.force, live.displacement)]
        over_time.run_chart_method("setOption", {"series": [{"data": curve} for curve in curves]})
        loop.run_chart_method("setOption", {"series": [{"data": _against(live)}]})

    return tick


def cue_of(live: Live) -> str:
    """What is to be done now."""
    said = live.latest
    return live.cue.sentence if said["state"] == "recording" else WORDS.get(said["state"], str(said["sentence"]))


def _figure(mark: str) -> ui.label:
    return ui.label().classes("figure").mark(mark)


def state_of(said: dict[str, Any]) -> str:
    """The state with its time; of a recording also what speaks against it already."""
    if said["state"] == "armed":
        return f"armed for {said['waited_s']:.0f} s, {said['left_s']:.0f} s left"
    if said["state"] == "recording":
        return f"recording {said['recorded_s']:.1f} s{said['sentence'].removeprefix('recording')}"
    return str(said["sentence"])


def _streams(said: dict[str, Any]) -> str:
    rates = [
        f"{name[1:]} {stream['rate_hz']:.0f} of {stream['nominal_hz']:.0f}/s"
        for name, stream in sorted(said.get("streams", {}).items())
    ]
    behind = f" · page fell behind by {said['dropped']}" if said.get("dropped") else ""
    left = said.get("disk_left_s")
    disk = f" · disk for {left / 3600:.0f} h" if left is not None else ""
    return " · ".join([*rates, f"lost {said.get('lost_samples', 0)}"]) + disk + behind


def _markers(seen: dict[str, bool]) -> str:
    hidden = sorted(name for name, is_seen in seen.items() if not is_seen)
    if not seen:
        return "markers: no frames yet"
    return f"hidden: {', '.join(hidden)}" if hidden else f"all {len(seen)} markers seen"


def _last(points: Iterable[tuple[float, float]]) -> list[list[float]]:
    kept = list(points)
    first = kept[-1][0] - SHOWN_S if kept else 0.0
    return [[t, y] for t, y in kept if t >= first][::2]


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
        "xAxis": axis_below(TIME_AXIS),
        "yAxis": [
            axis(FORCE_AXIS, FORCE),
            axis(DISPLACEMENT_AXIS, DISPLACEMENT, splitLine={"show": False}),
        ],
        "series": [line(FORCE), line(DISPLACEMENT, yAxisIndex=1)],
    }
