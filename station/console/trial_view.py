"""The trial: what comes next, and while it runs what to do now and that everything is alive."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterable
from typing import Any

from nicegui import ui

from station.console.agenda import Agenda
from station.console.charts import AXIS, LEGEND
from station.console.desk import Desk, Live
from station.console.guide import Rest

Acts = dict[str, Callable[[], Awaitable[None] | None]]
SHOWN_S = 20.0
"""Of each curve over time."""
WORDS = {"idle": "opening the devices", "armed": "armed: start the capture", "closing": "closing"}
COLOURS = {Rest.WAITING: "grey", Rest.MOVING: "negative", Rest.SETTLING: "warning", Rest.STEADY: "positive"}


def show_next(desk: Desk, plan: Agenda, act: Callable[..., Any], acts: Acts) -> None:
    spec = plan.spec
    assert spec is not None  # noqa: S101  (the page shows the summary then)
    if spec.cuff is None:
        order = "Hang the calibration weight on its spring under the load cell"
    elif plan.is_new_cuff:
        order = f"Don the {spec.cuff} cuff, rope slack"
    elif plan.has_pause:
        order = f"Let the wearer rest for {desk.config.protocol.pause_s:.0f} s"
    else:
        order = "Rope slack, wearer at ease"
    ui.label(order).classes("cue").mark("order")
    of_cuff = "bounce calibration" if spec.cuff is None else f"{spec.cuff}: {spec.test}, repeat {spec.repeat}"
    ui.label(f"next: {of_cuff}").classes("text-3xl").mark("next")
    if plan.has_pause:
        _rest(desk)
    acts["arm"] = desk.arm
    with ui.row():
        ui.button("Arm (a)", on_click=lambda: act(desk.arm)).mark("arm").classes("text-2xl")
        ui.button("Leave the session", on_click=lambda: act(desk.leave)).props("outline").mark("leave")
    ui.linear_progress(len(plan.done) / len(plan.trials), show_value=False).classes("w-full")
    with ui.row().classes("gap-2"):
        for each in plan.trials:
            name = "bounce" if each.cuff is None else f"{each.cuff} {each.test} {each.repeat}"
            ui.chip(
                name, icon="check" if each in plan.done else None, color="positive" if each in plan.done else "grey-5"
            )


def _rest(desk: Desk) -> None:
    """Counts down; nobody is kept from arming earlier, a wearer may have rested already."""
    left = ui.label().classes("figure").mark("rest")

    def count() -> None:
        seconds = desk.rest_left_s
        left.text = f"{seconds:.0f} s" if seconds > 0 else "rested"

    ui.timer(0.5, count)


def show_running(desk: Desk, live: Live, act: Callable[..., Any], acts: Acts) -> Callable[[], None]:
    """Returns what keeps the picture up to date, to be called ten times a second."""
    alarm = ui.label().classes("alarm w-full p-6 rounded").mark("alarm")
    cue = ui.label().classes("cue").mark("cue")
    with ui.row().classes("w-full items-end gap-12"):
        force, displacement, left = _figure("force"), _figure("displacement"), _figure("left")
        with ui.column().classes("gap-1"):
            rest = ui.badge("").classes("text-2xl p-3").mark("rest-state")
            state = ui.label().classes("text-xl").mark("state")
            sync = ui.label().classes("text-xl").mark("sync")
    with ui.row():
        ui.button("Stop (s)", color="negative", on_click=lambda: act(desk.stop)).mark("stop").classes("text-2xl")
        ui.button("Mark (m)", on_click=lambda: act(desk.mark)).props("outline").mark("mark")
        quiet = ui.button("I have seen it", on_click=lambda: act(desk.silence)).props("outline color=negative")
    acts |= {"stop": desk.stop, "mark": desk.mark}
    with ui.row().classes("w-full no-wrap gap-4"):
        over_time = ui.echart(_over_time()).classes("w-2/3 h-72").mark("over-time")
        loop = ui.echart(_loop()).classes("w-1/3 h-72").mark("loop")
    streams = ui.label().classes("text-xl").mark("streams")
    markers = ui.label().classes("text-xl").mark("markers")
    words = ui.label().classes("text-lg opacity-70 whitespace-pre-line")
    sound = ui.switch("speak the steps").mark("speak")
    spoken = {"cue": ""}

    def tick() -> None:
        said, now = live.latest, live.cue
        recording = said["state"] == "recording"
        alarm.text = live.alarm or ""
        alarm.set_visibility(live.alarm is not None)
        quiet.set_visibility(live.alarm is not None)
        cue.text = now.sentence if recording else WORDS.get(said["state"], said["sentence"])
        force.text = f"{live.force[-1][1]:.1f} N" if live.force else "- N"
        displacement.text = f"{live.displacement[-1][1]:+.1f} mm" if live.displacement else "- mm"
        left.text = f"{now.left_s:.0f} s" if recording and now.left_s is not None else ""
        rest.text, rest.props["color"] = now.rest.value, COLOURS[now.rest]
        rest.update()
        state.text = _state(said)
        level = said.get("sync_v")
        sync.text = f"sync line {level:.2f} V" if level is not None else "sync line: nothing yet"
        streams.text = _streams(said)
        markers.text = _markers(said.get("seen", {}))
        words.text = "\n".join(live.words)
        over_time.run_chart_method(
            "setOption", {"series": [{"data": _last(live.force)}, {"data": _last(live.displacement)}]}
        )
        loop.run_chart_method("setOption", {"series": [{"data": _against(live)}]})
        speech = live.alarm or (cue.text if sound.value else "")
        if sound.value and speech != spoken["cue"]:
            ui.run_javascript(
                f"speechSynthesis.cancel(); speechSynthesis.speak(new SpeechSynthesisUtterance({speech!r}))"
            )
        spoken["cue"] = speech

    return tick


def _figure(mark: str) -> ui.label:
    return ui.label().classes("figure").mark(mark)


def _state(said: dict[str, Any]) -> str:
    if said["state"] == "armed":
        return f"armed for {said['waited_s']:.0f} s, {said['left_s']:.0f} s left"
    return f"{said['state']} {said['recorded_s']:.1f} s" if said["state"] == "recording" else str(said["sentence"])


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
        "grid": {"left": 60, "right": 60, "top": 40, "bottom": 30},
        "legend": LEGEND,
        "xAxis": {**AXIS, "scale": True},
        "yAxis": [{**AXIS, "scale": True}, {**AXIS, "scale": True}],
        "series": [
            {"name": "force [N]", "type": "line", "showSymbol": False, "data": []},
            {"name": "displacement [mm]", "type": "line", "showSymbol": False, "yAxisIndex": 1, "data": []},
        ],
    }


def _loop() -> dict[str, Any]:
    return {
        "animation": False,
        "grid": {"left": 50, "right": 20, "top": 40, "bottom": 55},
        "xAxis": {**AXIS, "scale": True, "name": "displacement [mm]", "nameLocation": "middle", "nameGap": 30},
        "yAxis": {**AXIS, "scale": True, "name": "force [N]"},
        "series": [{"type": "line", "showSymbol": False, "lineStyle": {"width": 1.5}, "data": []}],
    }
