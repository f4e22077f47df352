"""How events are shown: text that fits, JSON that parses, and readers that go away."""

from __future__ import annotations

import io
import json
import math
import os

import pytest

from station.session.judgement import Figure, Row
from station.terminal.events import Decided, SessionOpened, VerdictGiven, Warned
from station.terminal.json_face import JsonFace
from station.terminal.text_face import SessionConsole, TextFace

OPENED = SessionOpened("P01", "monday", "monday", 2, 0, 0, is_simulated=False)
VERDICT = VerdictGiven(
    "a.mcap",
    "hand, static, repeat 1",
    "redo",
    ("k is 8508 N/m, the earlier repeats say 7000: 9 standard errors apart",),
    (Figure("stiffness_n_per_m", 8508.0, 8369.0, math.inf),),
    (Row("k [N/m]", "8508 (8369 to 8651)", "-", "8508 (8369 to 8651)"), Row("c [N s/m]", "-", "-", "-")),
    ("a note that is longer than the terminal is wide, as notes of the sync line's certificate are now and then",),
)


def test_a_verdict_fits_the_terminal_and_a_figure_that_is_not_there_takes_no_line() -> None:
    out, paths = io.StringIO(), io.StringIO()
    face = TextFace(SessionConsole(file=out, force_terminal=True, width=80, no_color=True), paths, is_interactive=False)
    for event in (OPENED, VERDICT, Decided("a.mcap", "accept", "", "station")):
        face.tell(event)
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 90, "80 and what sets it bold"
    assert any("8508 (8369 to 8651)" in line for line in lines) and not any("N s/m" in line for line in lines)
    assert paths.getvalue() == os.path.join("monday", "a.mcap") + "\n"  # noqa: PTH118


def test_an_open_interval_is_null_in_json() -> None:
    out = io.StringIO()
    JsonFace(out).tell(VERDICT)
    (figure,) = json.loads(out.getvalue())["figures"]
    assert figure == {"quantity": "stiffness_n_per_m", "value": 8508.0, "low": 8369.0, "high": None}


@pytest.mark.parametrize("is_json", [True, False])
def test_a_reader_that_has_gone_ends_nothing(is_json: bool) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb", buffering=0) as raw:
        gone = io.TextIOWrapper(raw, write_through=True)
        face = JsonFace(gone) if is_json else TextFace(SessionConsole(file=gone), gone, is_interactive=False)
        for event in (OPENED, Warned("alarm", "STOP"), VERDICT, Decided("a.mcap", "accept", "", "station")):
            face.tell(event)
        gone.detach()
        with pytest.raises(BrokenPipeError):  # what the face was written to, and has passed over
            raw.write(b"x")
