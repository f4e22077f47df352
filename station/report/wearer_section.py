"""Charts of the wearer's motions: elevation of the arm with its cycles, EMG envelopes, and the force of the cord."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from functools import partial
from pathlib import Path

import numpy as np

from fitting.emg.channels import UnusableEmg
from fitting.emg.envelopes import EmgEnvelopes, envelopes_of, largest_envelopes, normalised
from fitting.errors import UnusableTrial
from fitting.wearer.wearer_trial import WearerTrial, read_wearer_trial
from recordings.errors import RecordingError
from recordings.manifest import Manifest
from station import charts
from station.charts.marks import COLOURS, HALF, Array, Chart, Line, Panel, Rule, values
from station.charts.svg import draw
from station.emg.trials import EmgFileError, emg_of
from station.protocol import CONDITION_NAMES
from station.recordings_of_session import motions_in
from station.report.pictures import PlannedFigure

SHOWN_POINTS = 500
"""Of a curve."""
CAPTION = "Motion, {worn}: elevation of the arm, with the start of each cycle"
EMG_CAPTION = "EMG envelopes as a share of the maximum voluntary contraction"
RAW_CAPTION = "EMG envelopes, without a maximum voluntary contraction"
CORD_CAPTION = "force of the cord, less its least value"


def wearer_figures(folder: Path) -> list[PlannedFigure]:
    """A figure for every motion that can be read. The load cell is shown where it is in the cord."""
    found = motions_in(folder)
    if not found:
        return []
    maxima = _maxima(found)
    return [
        PlannedFigure(partial(motion_figure, trial, maxima), _caption(trial, maxima), is_printed=True)
        for path, manifest in sorted(found.items(), key=lambda motion: motion[1].start_utc_ns)
        if manifest.condition != "mvc" and (trial := _read(path)) is not None
    ]


def motion_drawing(path: Path, trial: WearerTrial) -> str:
    """The figure of one motion as HTML, with its own colours."""
    maxima = _maxima(motions_in(path.parent))
    style = Path(charts.__file__).with_name("chart.css").read_text(encoding="utf-8")
    return f"<style>{style}</style>{draw(motion_figure(trial, maxima), _caption(trial, maxima))}"


def motion_figure(trial: WearerTrial, maxima: Mapping[str, float]) -> Chart:
    """Elevation, EMG and cord force over session time, one below the other."""
    panels = [*_elevation(trial), *_emg(trial, maxima), *_cord(trial)]
    last = len(panels) - 1
    return Chart((tuple(_over_time(panel, trial, is_last=place == last) for place, panel in enumerate(panels)),))


def _caption(trial: WearerTrial, maxima: Mapping[str, float]) -> str:
    condition = trial.manifest.condition
    parts = [CAPTION.format(worn=CONDITION_NAMES[condition] if condition else "")]
    if _envelopes(trial) is not None:
        parts.append(EMG_CAPTION if maxima else RAW_CAPTION)
    if trial.body.is_cord_measured:
        parts.append(CORD_CAPTION)
    return "; ".join(parts)


def _read(path: Path) -> WearerTrial | None:
    try:
        return read_wearer_trial(path)
    except (UnusableTrial, RecordingError):
        return None  # the list of recordings has the reason


def _maxima(found: Mapping[Path, Manifest]) -> dict[str, float]:
    """Channel → largest envelope in a maximal contraction."""
    trials = [_read(path) for path, manifest in found.items() if manifest.condition == "mvc"]
    envelopes = [_envelopes(trial) for trial in trials if trial is not None]
    return largest_envelopes([one for one in envelopes if one is not None])


def _envelopes(trial: WearerTrial) -> EmgEnvelopes | None:
    if trial.emg is None:
        return None
    try:
        return envelopes_of(emg_of(trial))
    except (EmgFileError, UnusableEmg):
        return None


def _elevation(trial: WearerTrial) -> Iterator[Panel]:
    if trial.elevation is not None:
        cycles = (Rule(cycle.start, "quiet", dash="dotted", is_upright=True) for cycle in trial.cycles)
        yield Panel((_line(trial.time, np.degrees(trial.elevation), 1), *cycles), y_label="elevation [°]")


def _emg(trial: WearerTrial, maxima: Mapping[str, float]) -> Iterator[Panel]:
    envelopes = _envelopes(trial)
    if envelopes is None:
        return
    levels = normalised(envelopes, maxima) if maxima else envelopes
    scale, unit = (100.0, "EMG [% MVC]") if maxima else (1e6, "EMG [µV]")
    labels = enumerate(levels.usable)
    yield Panel(
        tuple(_line(levels.time, scale * levels.of(label), place, label) for place, label in labels), y_label=unit
    )


def _cord(trial: WearerTrial) -> Iterator[Panel]:
    if trial.body.is_cord_measured and len(trial.force):
        yield Panel((_line(trial.force_time, trial.force - float(np.nanmin(trial.force)), 2),), y_label="cord [N]")


def _line(time: Array, curve: Array, colour: int, label: str = "") -> Line:
    """At most SHOWN_POINTS, the means of equal parts of the curve."""
    every = max(1, len(time) // SHOWN_POINTS)
    kept = every * (len(time) // every)
    x, y = (values(part[:kept]).reshape(-1, every).mean(axis=1) for part in (time, curve))
    return Line(x, y, COLOURS[colour % len(COLOURS)], label, width=1.2)


def _over_time(panel: Panel, trial: WearerTrial, *, is_last: bool) -> Panel:
    limits = float(trial.time[0]), float(trial.time[-1])
    label, height = ("time from the sync edge [s]", 130.0) if is_last else ("", 100.0)
    return Panel(panel.marks, label, panel.y_label, x_limits=limits, width=HALF, height=height, has_x_numbers=is_last)
