"""What the console says aloud, in the browser: a tone and the words of a new step, where that is asked for; an alarm
always. A browser plays nothing before its page was touched once: a key or a click, as the one that armed."""

from __future__ import annotations

import json
import time

from nicegui import ui

STEP, ALARM = [880], [1760, 1320, 1760, 1320]
"""Hz of the tones, one after the other."""
ALARM_EVERY_S = 1.5
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
    speechSynthesis.speak(new SpeechSynthesisUtterance(%(words)s));
})()
"""


class AudioAlerts:
    """One page's voice during one trial."""

    def __init__(self) -> None:
        self._said = ""
        self._alarmed_s = 0.0

    def tell(self, cue: str, alarm: str | None, *, has_sound: bool) -> None:
        """Says what is new; an alarm again and again until somebody has seen it."""
        if alarm is not None:
            if time.monotonic() - self._alarmed_s >= ALARM_EVERY_S:
                self._alarmed_s = time.monotonic()
                _sound(ALARM, alarm)
            return
        if has_sound and cue != self._said:
            _sound(STEP, cue)
        self._said = cue


def _sound(tones: list[int], words: str) -> None:
    ui.run_javascript(SOUND % {"tones": json.dumps(tones), "words": json.dumps(words)})
