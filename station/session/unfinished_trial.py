"""How far a trial of a cuff or a bounce came, by its guide: the cause of a verdict if it ended before its last step."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np

from recordings.manifest import MeasurementProtocol, TestKind
from recordings.reader import Recording, open_recording
from station.config import ProtocolSection
from station.messages.codes import ReasonCode
from station.messages.message import Message
from station.session.guide import Cue, guide_for

POINT_S = 0.05


def find_unfinished(path: Path) -> Message[ReasonCode] | None:
    """The step at which the recorded trial ended; None for a whole one. Raises RecordingError."""
    recording = open_recording(path)
    return unfinished_step(recording.manifest.test, recording.manifest.protocol, _force(recording))


def unfinished_step(
    test: TestKind, planned: MeasurementProtocol, force: Iterable[tuple[float, float]]
) -> Message[ReasonCode] | None:
    """The step at which the force (s, N) of a trial ended; None after the last step, and if no steps are planned."""
    if test == "static" and not planned.step_masses_kg:
        return None
    known = {"step_masses_kg": planned.step_masses_kg, "hold_s": planned.hold_s, "swing_s": planned.swing_s}
    protocol = ProtocolSection.model_validate({name: value for name, value in known.items() if value is not None})
    guide = guide_for(test, protocol)
    guide.update(force)
    return _static(guide.cue()) if test == "static" else _swing(guide.cue(), protocol.swing_s)


def _static(cue: Cue) -> Message[ReasonCode] | None:
    if cue.is_done:
        return None
    weights, held = (cue.steps - 1) // 2, max(cue.step - 1, 0)
    if held < weights:
        return Message(ReasonCode.WEIGHTS_MISSING, {"found": held, "planned": weights})
    return Message(ReasonCode.UNLOADING_MISSING, {"found": held - weights, "planned": weights})


def _swing(cue: Cue, swing_s: float) -> Message[ReasonCode] | None:
    if cue.step > 1:
        return None
    swung_s = swing_s - cue.left_s if cue.step == 1 and cue.left_s is not None else 0.0
    return Message(ReasonCode.SWING_SHORT, {"found_s": swung_s, "planned_s": swing_s})


def _force(recording: Recording) -> list[tuple[float, float]]:
    track, cell = recording.load("/force"), recording.manifest.load_cell
    if not len(track.values):
        return []
    seconds = (track.device_time_ns - track.device_time_ns[0]) * 1e-9
    chosen = np.unique(np.searchsorted(seconds, np.arange(0.0, float(seconds[-1]), POINT_S)))
    scale = cell.polarity * cell.newtons_per_unit
    return [(float(seconds[at]), scale * float(track.values[at].flat[0])) for at in chosen]
