"""Sound in the browser: a tone and the spoken instruction of a new step, if it is switched on; an alarm always.

A browser plays no sound before the first key or click on its page; the one that armed the trial suffices.
"""

from __future__ import annotations

import json
import time

from nicegui import ui

STEP, ALARM = [880], [1760, 1320, 1760, 1320]
"""Frequencies [Hz] of consecutive tones."""
ALARM_INTERVAL_S = 1.5
SOUND = """
(() => {
    const audio = window.stationAudio ??= new AudioContext();
    audio.resume();
    %(tones)s.forEach((hertz, number) => {
        const tone = new OscillatorNode(audio, {type: "square", frequency: hertz});
        const from = audio.currentTime + 0.18 * number;
        tone.connect(new GainNode(audio, {gain: 0.2})).connect(audio.destination);
        tone.start(from);
        tone.stop(from + 0.15);
    });
    speechSynthesis.cancel();
    speechSynthesis.speak(Object.assign(new SpeechSynthesisUtterance(%(text)s), {lang: "en-US"}));
})()
"""


class AudioAlerts:
    """Sound of one page during one trial."""

    def __init__(self) -> None:
        self._spoken: object = None
        self._alarmed_s = 0.0

    def update(self, step: object, instruction: str, alarm: str | None, *, has_sound: bool) -> None:
        """Speak the instruction of a new step; repeat an alarm until the operator has seen it."""
        if alarm is not None:
            if time.perf_counter() - self._alarmed_s >= ALARM_INTERVAL_S:
                self._alarmed_s = time.perf_counter()
                _sound(ALARM, alarm)
            return
        if has_sound and step != self._spoken:
            _sound(STEP, instruction)
        self._spoken = step


def _sound(tones: list[int], text: str) -> None:
    ui.run_javascript(SOUND % {"tones": json.dumps(tones), "text": json.dumps(text)})
