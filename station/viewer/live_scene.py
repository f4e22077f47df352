"""Live values in Rerun: body, effort by scenario, cord force, EMG, findings; of a trial and of its replay alike."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path
from typing import Self

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from station.live.drawn_body import drawn_body
from station.live.published import LiveDelivery, LiveFinding, LiveSetup, LiveValues
from station.live.subscription import LiveSubscription
from station.viewer.viewer import BODY_NAME, TIMELINE, BodyScene, LineStyle, SceneExtent, open_stream

REFRESH_S = 0.1
BODY_INTERVAL_S = 0.04
"""Time between two drawn bodies."""
COLOURS = ((90, 100, 112), (30, 100, 190), (200, 80, 10), (0, 130, 100), (140, 80, 170), (200, 150, 30))
"""Of Okabe and Ito's palette, darkened for a light window."""
EFFORT, CORD, EMG = "live/effort", "live/cord_force_n", "live/emg_uv"


class LiveScene:
    """A sink of live values (station/live/engine.py): begin() once, then write() for every solved frame.

    The body wears the suit of the scenario "worn", without one the last scenario. Times are UTC, by the cameras' clock.
    """

    def __init__(self, sink: Path | str) -> None:
        """An .rrd file, or the address of a viewer."""
        self.stream = open_stream("cuffstation live", sink)
        self._told: set[str] = set()
        self._next_body_s = -math.inf
        self._origin_s: float | None = None
        self._extent: SceneExtent | None = None

    def begin(self, setup: LiveSetup) -> None:
        model, suit = drawn_body(setup)
        self._setup, self._body = setup, BodyScene(self.stream, model, suit)
        names = [scenario.name for scenario in setup.scenarios]
        self._worn = names.index("worn") if "worn" in names else len(names) - 1
        for place, name in enumerate(names):
            self._style(_effort_path(name), name, (COLOURS[place % len(COLOURS)], 2.0))
        for place, name in enumerate(("predicted", *(["measured"] if setup.has_cord_cell else []))):
            self._style(f"{CORD}/{name}", name, (COLOURS[1 + place], 2.0))
        for place, name in enumerate(setup.emg_channels):
            self._style(f"{EMG}/{name}", name, (COLOURS[place % len(COLOURS)], 1.5))
        self.stream.send_blueprint(self._layout())
        scaled = "scaled to the wearer" if setup.subject.is_scaled else "generic, not scaled to the wearer"
        self.note("body", f"{setup.trial}; body {setup.subject.name}, {scaled}; lag {1e3 * setup.lag_s:.0f} ms")

    def begin_recording(self, recording: Path) -> None:
        self.note("recording", recording.name)

    def write(self, values: LiveValues, delivery: LiveDelivery) -> None:
        if self._origin_s is None:
            age_s = delivery.age_s if math.isfinite(delivery.age_s) else 0.0
            self._origin_s = delivery.published_s - age_s - values.time_s
        time_ns = round(1e9 * (self._origin_s + values.time_s))
        self.stream.set_time(TIMELINE, timestamp=np.datetime64(time_ns, "ns"))
        for scenario, solved in zip(self._setup.scenarios, values.scenarios, strict=True):
            self._log(_effort_path(scenario.name), solved.effort)
        self._log(f"{CORD}/predicted", values.scenarios[self._worn].cord_force_n if values.scenarios else math.nan)
        self._log(f"{CORD}/measured", values.cord_force_measured_n)
        for name, rms in zip(self._setup.emg_channels, values.emg_rms_uv, strict=False):
            self._log(f"{EMG}/{name}", rms)
        if values.time_s > self._next_body_s and values.scenarios and np.isfinite(values.coordinates).all():
            self._next_body_s = values.time_s + 0.9 * BODY_INTERVAL_S
            self._draw(time_ns, values)

    def note(self, kind: str, text: str) -> None:
        self.stream.log("events", rr.TextLog(f"{kind}: {text}"))

    def tell(self, findings: Sequence[LiveFinding]) -> None:
        """Log findings that are new since the last call."""
        for finding in findings:
            if finding.sentence not in self._told:
                self.note(finding.code, finding.sentence)
        self._told = {finding.sentence for finding in findings}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.stream.disconnect()

    def _draw(self, time_ns: int, values: LiveValues) -> None:
        activations = np.array(values.scenarios[self._worn].activations)[None]
        extent = self._body.log(np.array([time_ns]), np.array(values.coordinates)[None], activations)
        if self._extent is None:
            self._extent = extent
            self.stream.send_blueprint(self._layout())

    def _log(self, path: str, value: float) -> None:
        if math.isfinite(value):
            self.stream.log(path, rr.Scalars(value))

    def _style(self, path: str, name: str, style: LineStyle) -> None:
        self.stream.log(path, rr.SeriesLines(names=name, colors=style[0], widths=style[1]), static=True)

    def _layout(self) -> rrb.Blueprint:
        eye = self._extent.eye((0.0, 1.0, 0.0)) if self._extent else None
        body = rrb.Spatial3DView(origin="/body", name=BODY_NAME, eye_controls=eye)
        curves = [
            rrb.TimeSeriesView(origin=f"/{EFFORT}", name="Muscle effort \u03a3 w a\u00b2"),
            rrb.TimeSeriesView(origin=f"/{CORD}", name="Cord force [N]"),
        ]
        curves += [rrb.TimeSeriesView(origin=f"/{EMG}", name="EMG RMS [\u00b5V]")] if self._setup.emg_channels else []
        events = rrb.TextLogView(origin="/events", name="Findings")
        return rrb.Blueprint(
            rrb.Horizontal(body, rrb.Vertical(*curves, events)),
            rrb.BlueprintPanel(state="collapsed"),
            rrb.SelectionPanel(state="collapsed"),
            rrb.TimePanel(state="collapsed", timeline=TIMELINE),
        )


def _effort_path(scenario: str) -> str:
    """Rerun's paths have no spaces."""
    return f"{EFFORT}/{scenario.replace(' ', '_')}"


def show_live(subscription: LiveSubscription, scenes: Sequence[LiveScene]) -> None:
    """Log what a live process publishes, until it ends."""
    for scene in scenes:
        scene.begin(subscription.setup)
    is_over = False
    while not is_over:
        is_over = subscription.wait_until_over(REFRESH_S)
        for update in subscription.take():
            for scene in scenes:
                scene.tell(update.findings)
                if update.values is not None:
                    scene.write(update.values, update.delivery)
