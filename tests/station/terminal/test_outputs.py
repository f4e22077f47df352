"""Events as text that fits the terminal and as JSON; a reader that ends does not end the session."""

import io
import json
import math
import os

import pytest

from documents.message import Message
from fitting.results.codes import Verdict
from station.messages.session_messages import ReasonCode
from station.session.judgement import Judgement, Row, TrialQuantity
from station.terminal.events import Decided, SessionOpened, VerdictGiven, WarningRaised
from station.terminal.run import KEYS_BETWEEN, KEYS_RECORDING, JsonOutput, SessionConsole, TextOutput

OPENED = SessionOpened("P01", "monday", "monday", 2, 0, 0, is_simulated=False)
JUDGEMENT = Judgement(
    "a.mcap",
    "hand, static, repeat 1",
    "redo",
    (Message(ReasonCode.LOST_SAMPLES, {"samples": 12}),),
    (Row("k [N/m]", "8508 (8369 to 8651)", "-", "8508 (8369 to 8651)"), Row("c [N s/m]", "-", "-", "-")),
    ("a note that is longer than the terminal is wide, as notes of the sync line's certificate are now and then",),
    figures=(TrialQuantity("stiffness_n_per_m", 8508.0, 8369.0, math.inf),),
    verdicts=(Verdict.NOT_UNLOADED,),
)
VERDICT = VerdictGiven.of(JUDGEMENT)


def test_a_verdict_fits_the_terminal_and_a_missing_figure_has_no_line() -> None:
    out, paths = io.StringIO(), io.StringIO()
    console = SessionConsole(file=out, force_terminal=True, width=80, no_color=True)
    output = TextOutput(console, paths, is_interactive=False)
    for event in (OPENED, VERDICT, Decided("a.mcap", "accept", "", "station")):
        output.show_event(event)
    lines = out.getvalue().splitlines()
    assert max(map(len, lines)) <= 90, "80 and what sets it bold"
    assert max(map(len, (KEYS_BETWEEN, KEYS_RECORDING))) < 80
    assert any("8508 (8369 to 8651)" in line for line in lines) and not any("N s/m" in line for line in lines)
    assert paths.getvalue() == os.path.join("monday", "a.mcap") + "\n"  # noqa: PTH118


def test_every_key_is_named_on_a_narrow_terminal() -> None:
    out = io.StringIO()
    console = SessionConsole(file=out, force_terminal=True, width=50, no_color=True)
    with TextOutput(console, io.StringIO(), is_interactive=True) as output:
        output.show_trial(None)
    assert all(key in out.getvalue() for key in KEYS_BETWEEN.split("  "))


def test_an_open_interval_is_null_in_json() -> None:
    out = io.StringIO()
    JsonOutput(out).show_event(VERDICT)
    read = json.loads(out.getvalue())
    (figure,) = read["figures"]
    assert figure == {"quantity": "stiffness_n_per_m", "value": 8508.0, "low": 8369.0, "high": None}
    assert read["reason_codes"] == [{"code": "reason.lost_samples", "figures": {"samples": 12}}]
    assert (read["grade"], read["verdict_codes"]) == ("bad", ["migration_not_identified.not_unloaded"])


@pytest.mark.parametrize("is_json", [True, False])
def test_a_closed_reader_does_not_end_the_session(is_json: bool) -> None:
    reader, writer = os.pipe()
    os.close(reader)
    with os.fdopen(writer, "wb", buffering=0) as raw:
        gone = io.TextIOWrapper(raw, write_through=True)
        text = TextOutput(SessionConsole(file=gone), gone, is_interactive=False)
        output = JsonOutput(gone) if is_json else text
        for event in (OPENED, WarningRaised("alarm", "STOP"), VERDICT, Decided("a.mcap", "accept", "", "station")):
            output.show_event(event)
        gone.detach()
        with pytest.raises(OSError, match=r"Broken pipe|Invalid argument"):  # which the output ignored
            raw.write(b"x")
