import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest

from documents.message import Figures, Message
from recordings.manifest import CuffSite
from station import journal
from station.checksums import JOURNAL_FILE, drafted, write_whole
from station.errors import StationError
from station.journal import (
    Assignment,
    Decision,
    Journal,
    JournalError,
    Recorded,
    Setup,
    append_line,
    read_journal,
    write_assigned,
    write_donned,
    write_mark,
    write_next,
    write_note,
    write_recorded,
    write_setup,
    write_skipped,
    write_undone,
    write_verdict,
)
from station.messages.bench_messages import TrialCode
from station.messages.session_messages import JournalCode
from station.protocol import TrialSpec
from tests.links import symlink
from tests.refusals import raises_refusal
from tests.timeout import scaled_timeout

SETUP = Setup("P01", "ab", ("hand", "elbow"), 3)
ENDED = Message(TrialCode.CAPTURE_ENDED)
TRIAL = Recorded("a.mcap", "hand", "static", 1, "1", True, 0, str(ENDED), codes=(ENDED,))
ELBOW = CuffSite("elbow", "arm", ("a", "b", "c"), ("d",))

PUBLISHED = Path(__file__).parents[2] / "docs" / "schemas" / "session.schema.json"


def line_of(kind: str, **fields: object) -> str:
    return json.dumps({"kind": kind, "at": "", "format": 1} | fields)


VERDICT = {"file": "a.mcap", "choice": "accept", "reason": ""}
PLAN = {"subject": "P01", "operator": "a", "cuffs": ["hand"], "repeats": 3}
ENTRY = {"file": "a.mcap", "cuff": None, "test": "static", "repeat": 1, "donning": "1", "accepted": True}
ENTRY |= {"lost_samples": 0, "sentence": ""}
MARK = line_of("mark", file="a.mcap", number=1, name="")
WRONG_LINES = (
    *("{", "[]", "null", "[" * 100_000, '{"a":' * 100_000),
    *('{"kind": "setup", "at": ""}', '{"kind": "dream", "at": ""}'),
    line_of("donned", cuff="hand", format=2),
    line_of("recorded", **ENTRY, codes=[{"code": "dream"}]),
    line_of("recorded", **ENTRY | {"cuff": 1, "repeat": "x"}),
    *(line_of("setup", **PLAN | wrong) for wrong in ({"cuffs": "hand"}, {"subject": []}, {"repeats": 0})),
    line_of("setup", **PLAN | {"repeats": 1001}),
    *(MARK.replace('"number": 1', f'"number": {number}') for number in ("7" * 400, "1e999")),
    *(line_of("verdict", **VERDICT | wrong) for wrong in ({"file": "a\0.mcap"}, {"file": ["a.mcap"]}, {"reason": {}})),
)
"""Lines that are whole and are still no entries of format 1."""
RIGHT_LINES = (
    *(line_of("donned", cuff="hand"), line_of("recorded", **ENTRY), line_of("setup", **PLAN)),
    *(line_of("setup", **PLAN | {"repeats": repeats}) for repeats in (1, 1000)),
    *(MARK, line_of("verdict", **VERDICT)),
)
"""Those that the wrong ones were made of."""


def test_written_entries_are_read_and_fit_the_published_schema(tmp_path: Path) -> None:
    assert read_journal(tmp_path) == Journal()
    write_setup(tmp_path, SETUP)
    write_recorded(tmp_path, TRIAL)
    write_verdict(tmp_path, "a.mcap", "redo", " the cuff slipped ")
    write_mark(tmp_path, "a.mcap", 2, "coughed")
    write_donned(tmp_path, "hand")
    journal = read_journal(tmp_path)
    assert journal.setup == SETUP and SETUP.has_bounce
    assert journal.recorded == (TRIAL,)
    assert journal.verdicts == {"a.mcap": Decision("redo", "the cuff slipped")}
    assert journal.redone == {"a.mcap": "the cuff slipped"}
    assert journal.marks == {"a.mcap": {2: "coughed"}}
    assert journal.donnings == {"hand": 1}
    write_skipped(tmp_path, TrialSpec(None, "bounce", 1))
    write_next(tmp_path, TrialSpec(None, "bounce", 1))
    write_note(tmp_path, "a.mcap", "a warm day")
    write_undone(tmp_path, "a.mcap", donned_cuff="hand")
    write_assigned(tmp_path, "a.mcap", Assignment(ELBOW, "static", 1, "1"))
    lines = [json.loads(line) for line in (tmp_path / JOURNAL_FILE).read_text().splitlines()]
    schema = json.loads(PUBLISHED.read_text())
    kinds = {kind: name.rpartition("/")[2] for kind, name in schema["discriminator"]["mapping"].items()}
    assert {line["kind"] for line in lines} == set(kinds)
    for line in lines:
        assert set(line) == set(schema["$defs"][kinds[line["kind"]]]["properties"])
    (recorded,) = (line for line in lines if line["kind"] == "recorded")
    assert recorded["codes"] == [{"code": "capture_ended", "figures": {}}]
    assert "capture_ended" in schema["$defs"]["TrialCode"]["enum"]


def test_the_later_verdict_counts_and_the_earlier_stays_in_the_file(tmp_path: Path) -> None:
    write_verdict(tmp_path, "a.mcap", "redo", "the wearer moved")
    write_verdict(tmp_path, "a.mcap", "accept", "on second thought")
    assert read_journal(tmp_path).redone == {}
    assert (tmp_path / JOURNAL_FILE).read_text().count('"kind": "verdict"') == 2


def test_an_undone_decision_is_removed_with_its_donning(tmp_path: Path) -> None:
    write_verdict(tmp_path, "a.mcap", "redo", "the wearer moved")
    write_donned(tmp_path, "hand")
    write_verdict(tmp_path, "b.mcap", "accept", "")
    write_undone(tmp_path, "a.mcap", donned_cuff="hand")
    journal = read_journal(tmp_path)
    assert list(journal.verdicts) == ["b.mcap"]
    assert journal.donnings == {"hand": 0} and journal.redone == {}


def test_an_assigned_recording_is_of_the_other_trial(tmp_path: Path) -> None:
    write_recorded(tmp_path, TRIAL)
    given = Assignment(ELBOW, "dynamic", 2, "1")
    write_assigned(tmp_path, "a.mcap", given)
    journal = read_journal(tmp_path)
    assert journal.assignments == {"a.mcap": given}
    assert journal.recorded == (replace(TRIAL, cuff="elbow", test="dynamic", repeat=2),)


def test_a_recording_that_two_processes_enter_is_one_trial_as_its_recorder_states_it(tmp_path: Path) -> None:
    """A console that resumes the session enters the file in the moment before the entry of the recorder."""
    adopted, other = replace(TRIAL, codes=(), sentence=""), replace(TRIAL, file="b.mcap", repeat=2)
    for trial in (adopted, other):
        write_recorded(tmp_path, trial)
    write_assigned(tmp_path, "a.mcap", Assignment(ELBOW, "static", 3, "1"))
    write_recorded(tmp_path, TRIAL)
    assert read_journal(tmp_path).recorded == (replace(TRIAL, cuff="elbow", repeat=3), other)


def test_a_session_has_its_start_time(tmp_path: Path) -> None:
    before = datetime.now(UTC)
    write_setup(tmp_path, SETUP)
    write_recorded(tmp_path, TRIAL)
    begun = datetime.fromisoformat(read_journal(tmp_path).begun)
    assert before - timedelta(seconds=1) <= begun <= datetime.now(UTC)


def test_the_last_choice_of_a_trial_overrules(tmp_path: Path) -> None:
    one, other = TrialSpec(None, "motion", 1, condition="tight"), TrialSpec("hand", "static", 2, donning="3")
    write_next(tmp_path, one)
    write_next(tmp_path, other)
    assert read_journal(tmp_path).chosen == (other, one)
    write_skipped(tmp_path, other)
    assert (read_journal(tmp_path).chosen, read_journal(tmp_path).skipped) == ((one,), {other})
    write_next(tmp_path, other)
    assert (read_journal(tmp_path).chosen, read_journal(tmp_path).skipped) == ((other, one), set())


@pytest.mark.parametrize("pasted", ["a\0b", "a\ud800b", "\0", "a\u2028b\x1b[31m", 5000 * "[" + "\r\n"])
def test_a_pasted_note_leaves_the_journal_readable(tmp_path: Path, pasted: str) -> None:
    write_note(tmp_path, "a.mcap", "before")
    write_note(tmp_path, "", pasted)
    write_note(tmp_path, "b.mcap", "after")
    notes = read_journal(tmp_path).notes
    assert (notes["a.mcap"], notes["b.mcap"]) == ("before", "after")
    assert "\0" not in notes[""]


def test_a_line_that_no_reader_accepts_is_not_written(tmp_path: Path) -> None:
    append_line(tmp_path / "checks.jsonl", "mass", mass_kg=2.0)
    before = (tmp_path / "checks.jsonl").read_bytes()
    with raises_refusal(JournalCode.NOT_WRITTEN, kind=StationError):
        append_line(tmp_path / "checks.jsonl", "mass", mass_kg=[{"unit": "k\0g"}])
    assert (tmp_path / "checks.jsonl").read_bytes() == before


def test_a_later_note_replaces_the_earlier_one_of_the_same_recording(tmp_path: Path) -> None:
    for file, text in (
        ("", "rainy"),
        ("a.mcap", "wearer coughed"),
        ("", " rainy, 18 \u00b0C\n"),
        ("b.mcap", "x" * 20_000),
    ):
        write_note(tmp_path, file, text)
    notes = read_journal(tmp_path).notes
    assert (notes[""], notes["a.mcap"], len(notes["b.mcap"])) == ("rainy, 18 \u00b0C", "wearer coughed", 10_000)


def test_a_line_of_another_file_has_its_time_and_kind_in_a_folder_that_is_made(tmp_path: Path) -> None:
    path = tmp_path / "monday" / "P01" / "telemetry.jsonl"
    append_line(path, "started", answer=42)
    line = json.loads(path.read_text())
    assert (line["kind"], line["answer"]) == ("started", 42)
    assert datetime.now(UTC) - datetime.fromisoformat(line["at"]) < timedelta(minutes=10)


def test_a_redo_needs_a_reason(tmp_path: Path) -> None:
    with raises_refusal(JournalCode.NO_REASON, kind=JournalError) as caught:
        write_verdict(tmp_path, "a.mcap", "redo", "  ")
    assert figures_of(caught.value) == {"file": "a.mcap"}
    assert not (tmp_path / JOURNAL_FILE).exists()


def test_an_incomplete_line_is_ignored_and_not_joined_to_the_next(tmp_path: Path) -> None:
    write_setup(tmp_path, SETUP)
    write_recorded(tmp_path, TRIAL)
    path = tmp_path / JOURNAL_FILE
    whole = path.read_bytes()
    first = len(whole.splitlines(keepends=True)[0])
    for cut in (*range(first, len(whole), 40), len(whole) - 1):
        path.write_bytes(whole[:cut])
        assert read_journal(tmp_path).setup == SETUP
        write_verdict(tmp_path, "a.mcap", "accept", "")
        journal = read_journal(tmp_path)
        assert (journal.setup, set(journal.verdicts)) == (SETUP, {"a.mcap"})


def test_the_longest_plan_has_a_thousand_repeats(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_FILE).write_text("\n".join((*RIGHT_LINES, "")))
    setup = read_journal(tmp_path).setup
    assert setup is not None and setup.repeats == 1000


@pytest.mark.parametrize("line", WRONG_LINES, ids=lambda line: line[:60])
def test_a_wrong_line_is_named(tmp_path: Path, line: str) -> None:
    path = tmp_path / JOURNAL_FILE
    path.write_text("\n".join((*RIGHT_LINES, line, "")))
    with raises_refusal(JournalCode.WRONG_LINE, kind=JournalError) as caught:
        read_journal(tmp_path)
    number = len(RIGHT_LINES) + 1
    assert figures_of(caught.value) == {"path": str(path), "line": number, "found": repr(line[:60])}


@pytest.mark.parametrize(
    ("size", "last", "is_read"), [(16 * 2**20, b"\n", True), (16 * 2**20 + 1, b"\n", False), (2, b"\xff", False)]
)
def test_a_journal_above_16_mib_or_of_other_bytes_is_not_read(
    tmp_path: Path, size: int, last: bytes, is_read: bool
) -> None:
    path = tmp_path / JOURNAL_FILE
    line = b'{"kind": "donned", "at": "", "format": 1, "cuff": "hand"}'
    path.write_bytes(line.ljust(size - len(last)) + last)
    if is_read:
        assert read_journal(tmp_path).donnings == {"hand": 1}
        return
    with raises_refusal(JournalCode.UNREADABLE, kind=JournalError) as caught:
        read_journal(tmp_path)
    reason = figures_of(caught.value)["reason"]
    assert figures_of(caught.value)["path"] == str(path)
    assert isinstance(reason, str) and reason.startswith("larger than" if size > 2 else "'utf-8'")


def test_a_failed_write_is_an_error(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_FILE).mkdir()
    with raises_refusal(JournalCode.NOT_WRITTEN, kind=JournalError):
        write_setup(tmp_path, SETUP)


def figures_of(error: StationError) -> Figures:
    assert isinstance(error.cause, Message)
    return error.cause.figures


def test_two_processes_that_write_at_once_keep_every_line_of_both(tmp_path: Path) -> None:
    many = (
        "import sys; from pathlib import Path; from station.journal import write_mark\n"
        "for number in range(60): write_mark(Path(sys.argv[1]), 'a.mcap', number, sys.argv[2] * 500)"
    )
    writers = [subprocess.Popen([sys.executable, "-c", many, str(tmp_path), who]) for who in ("console", "terminal")]  # noqa: S603
    assert [writer.wait(scaled_timeout(60)) for writer in writers] == [0, 0]
    entries = [json.loads(line) for line in (tmp_path / JOURNAL_FILE).read_text().splitlines()]
    assert {entry["format"] for entry in entries} == {1}
    for who in ("console", "terminal"):
        assert [entry["number"] for entry in entries if entry["name"] == who * 500] == list(range(60))


def test_a_long_journal_is_read_in_one_pass(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """No line copies those before it: the number of copies is what a journal of a megabyte would be hung by."""
    copies: list[object] = []
    monkeypatch.setattr(journal, "replace", lambda *given, **_: copies.append(given))
    line = '{"at": "", "kind": "mark", "format": 1, "file": "a.mcap", "number": %d, "name": ""}\n'
    (tmp_path / JOURNAL_FILE).write_text("".join(line % number for number in range(20_000)))
    assert len(read_journal(tmp_path).marks["a.mcap"]) == 20_000
    assert not copies


@pytest.mark.parametrize("link", [symlink, Path.hardlink_to])
def test_a_journal_that_is_a_link_is_not_written_to(tmp_path: Path, link: Callable[[Path, Path], None]) -> None:
    """Its last line is taken away where no line break ends it, as a torn one: another file's must not be."""
    other = tmp_path / "letter.txt"
    other.write_text("first line\nlast line")
    link(tmp_path / JOURNAL_FILE, other)
    with raises_refusal(JournalCode.NOT_WRITTEN, kind=JournalError):
        write_verdict(tmp_path, "a.mcap", "accept", "")
    assert other.read_text() == "first line\nlast line"


def test_a_text_with_a_name_that_is_not_utf_8_is_written_as_utf_8(tmp_path: Path) -> None:
    write_whole(tmp_path / "report.html", "session \udcff \u00b1")
    assert (tmp_path / "report.html").read_text(encoding="utf-8") == "session ? \u00b1"


def test_a_failed_write_keeps_the_previous_file_and_names_it(tmp_path: Path) -> None:
    path = tmp_path / "cuffs.json"
    write_whole(path, "before")
    with pytest.raises(OSError, match="No space left") as caught, drafted(path) as draft:
        draft.write_text("half")
        raise OSError(28, "No space left on device")
    assert caught.value.filename == str(path)
    assert path.read_text() == "before"
    assert [each.name for each in tmp_path.iterdir()] == ["cuffs.json"]
