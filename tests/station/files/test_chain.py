"""A file that has changed since it was recorded is reported by every verb that reads it, and by `station verify`."""

import hashlib
import json
import os
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from documents.message import Message
from fitting.cuffs.cuffs_file import read_cuffs
from fitting.results.codes import Standing
from fitting.results.trial_codes import RejectionCode
from solver.bundled import bundled_model, simulate_arm_raise
from solver.time_series_table import write_table
from station.checksums import CHECKSUMS_FILE, JOURNAL_FILE, Checksums, write_checksums
from station.files.chain import verify_folder
from station.fit import fit_session_folder
from station.journal import Setup, write_mark, write_setup, write_verdict
from station.messages.file_messages import ChainCode
from station.messages.setup_messages import FolderCode
from station.recordings_of_session import originals_in, recordings_in, useless_copies_in
from tests.station.bench.test_session_folder import record
from tests.station.command import Station, assert_refused
from tests.station.foreign import static_and_dynamic
from tests.station.reported import DYNAMIC, STATIC

AS_RECORDED, CHANGED, BY_HAND, MISSING = (Standing.AS_RECORDED, Standing.CHANGED, Standing.BY_HAND, Standing.MISSING)
needs_ssh_keygen = pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="needs OpenSSH's ssh-keygen")


@pytest.fixture
def session(reported: Path, tmp_path: Path) -> Path:
    """A copy to spoil."""
    return Path(shutil.copytree(reported, tmp_path / "session"))


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    raised = simulate_arm_raise(bundled_model())
    path = tmp_path / "short.mot"
    write_table(path, raised.names, raised.time[:60:4], raised.coordinates[:60:4])
    return path


def edit(path: Path, change: Callable[[Any], None]) -> None:
    """As a person does in an editor."""
    plain = json.loads(path.read_text(encoding="utf-8"))
    change(plain)
    path.write_text(json.dumps(plain, indent=1), encoding="utf-8")


def stiffen(plain: Any) -> None:
    plain["cuffs"]["hand"]["stiffness_n_per_m"]["value"] = 40000


def replace_trial(path: Path) -> None:
    """By another one under its name."""
    path.unlink()
    static_and_dynamic(4)[0].record(path)


def verified(station: Station, folder: Path, *words: object) -> tuple[int, dict[str, str]]:
    """Exit code and link → standing of a verification."""
    ran = station("verify", folder, *words, "--format", "json")
    return ran.code, {link["what"]: link["standing"] for link in json.loads(ran.out)}


def test_every_link_of_an_unchanged_session_is_as_recorded(reported: Path, station: Station) -> None:
    ran = station("verify", reported)
    assert ran.code == 0, ran.out
    lines = ran.out.splitlines()
    assert all(line.split(" (")[0].endswith(": as recorded") for line in lines), ran.out
    links = [line.rpartition(": as recorded")[0] for line in lines]
    assert links[:4] == ["report.html", "report.json", "assessment.json", "cuffs.json"]
    assert links.index(STATIC) < links.index("assessment.json ← cuffs.json") < links.index(f"cuffs.json ← {STATIC}")
    if program := shutil.which("sha256sum"):
        check = [program, "--strict", "-c", CHECKSUMS_FILE]
        listed = subprocess.run(check, cwd=reported, check=True, capture_output=True)  # noqa: S603
        assert listed.stdout.count(b": OK") == len(Checksums(reported).sums) >= 6


def test_a_recorder_records_the_hash_of_its_trial(tmp_path: Path) -> None:
    path = record(tmp_path, None)
    assert Checksums(tmp_path).sums == {path.name: hashlib.sha256(path.read_bytes()).hexdigest()}


def test_an_edited_stiffness_is_reported_by_assess_and_report(session: Path, motion: Path, station: Station) -> None:
    edit(session / "cuffs.json", stiffen)
    ran = station("report", session)
    assert ran.code == 3
    assert f"cuffs.json: {CHANGED}" in ran.err
    page = (session / "report.html").read_text(encoding="utf-8")
    assert '<div class="note" id="doubts">' in page

    ran = station("assess", "--cuffs", session / "cuffs.json", "--output", session, "--motion", motion, "--people", 0)
    assert ran.code == 3 and str(Message(ChainCode.CHANGED, {"file": "cuffs.json", "sums": CHECKSUMS_FILE})) in ran.err
    plain = json.loads((session / "assessment.json").read_text(encoding="utf-8"))
    worn = plain["cuffs"]["hand"]
    assert worn["stiffness_n_per_m"]["value"] == 40000
    assert plain["inputs_checked"] == {"cuffs": CHANGED}
    page = (session / "report.html").read_text(encoding="utf-8")
    assert "were solved with another stiffness of cuff hand than that in the table: 40000 N/m" in page

    code, links = verified(station, session)
    assert (code, links["cuffs.json"]) == (1, CHANGED)


def test_an_edited_assessment_is_reported_after_a_new_fit(session: Path, station: Station) -> None:
    edit(session / "assessment.json", lambda plain: plain["cuffs"]["hand"]["stiffness_n_per_m"].update(value=40000))
    assert station("fit", session).code == 0
    ran = station("report", session)
    assert ran.code == 3 and f"assessment.json: {CHANGED}" in ran.err
    assert "than that in the table: 40000 N/m, and the table has" in (session / "report.html").read_text(
        encoding="utf-8"
    )


def test_a_replaced_trial_is_reported_by_every_verb(session: Path, tmp_path: Path, station: Station) -> None:
    replace_trial(session / STATIC)
    changed = str(Message(ChainCode.CHANGED, {"file": STATIC, "sums": CHECKSUMS_FILE}))
    ran = station("info", session / STATIC)
    assert ran.code == 3 and f"{STATIC}: {CHANGED}, by {CHECKSUMS_FILE}" in ran.out
    exported = station("export", session / STATIC, "--to", "csv", "--output", tmp_path / "out")
    assert exported.code == 3 and changed in exported.err
    (sidecar,) = (tmp_path / "out").glob("*.json")
    assert json.loads(sidecar.read_text(encoding="utf-8"))["checked"] == CHANGED
    assert changed in station("replay", session / STATIC, "--speed", "100").err

    ran = station("report", session)
    assert ran.code == 3 and f"cuffs.json ← {STATIC}: {CHANGED}" in ran.err
    ran = station("fit", session)
    assert ran.code == 3 and changed in ran.err
    fitted = json.loads((session / "cuffs.json").read_text(encoding="utf-8"))
    standing = {name: entry["standing"] for name, entry in fitted["recordings"].items()}
    assert standing == {STATIC: CHANGED, DYNAMIC: AS_RECORDED}
    code, links = verified(station, session)
    assert (code, links[STATIC]) == (1, CHANGED)


def test_a_recording_replaced_with_its_line_in_the_list_is_not_the_fitted_one(session: Path, station: Station) -> None:
    replace_trial(session / STATIC)
    write_checksums(session / STATIC)
    _, found = verified(station, session)
    assert (found[STATIC], found[f"cuffs.json \u2190 {STATIC}"]) == (AS_RECORDED, CHANGED)
    assert found[f"cuffs.json \u2190 {DYNAMIC}"] == AS_RECORDED


@pytest.mark.parametrize("kind", ["completed", "recovered"])
def test_a_copy_of_another_trial_does_not_replace_a_recording(session: Path, kind: str) -> None:
    copy = session / STATIC.replace(".mcap", f".{kind}.mcap")
    shutil.copy(session / DYNAMIC, copy)
    assert [path.name for path in recordings_in(session)] == [path.name for path in originals_in(session)]
    fitted = fit_session_folder(session, None)
    assert {trial.file: trial.reason.code for trial in fitted.rejected} == {copy.name: RejectionCode.OTHER_TRIAL}
    assert set(fitted.recordings) == {STATIC, DYNAMIC}


@pytest.mark.parametrize("kind", ["completed", "recovered"])
@pytest.mark.parametrize("kept", [0.0, 0.5])
def test_a_cut_copy_replaces_only_a_recording_that_cannot_be_read(session: Path, kind: str, kept: float) -> None:
    content, copy = (session / STATIC).read_bytes(), session / STATIC.replace(".mcap", f".{kind}.mcap")
    copy.write_bytes(content[: int(kept * len(content))])
    assert [path.name for path in recordings_in(session)] == [path.name for path in originals_in(session)]
    assert [path.name for path in useless_copies_in(session)] == [copy.name]
    (session / STATIC).write_bytes(b"")
    assert copy in recordings_in(session) and not useless_copies_in(session)


def test_a_deleted_recording_is_missing(session: Path, station: Station) -> None:
    (session / DYNAMIC).unlink()
    code, links = verified(station, session)
    assert code == 1
    assert links[f"report.json ← {DYNAMIC}"] == links[f"cuffs.json ← {DYNAMIC}"] == links[DYNAMIC] == MISSING


@pytest.mark.parametrize("name", ["report.html", "assessment.json", "cuffs.json", "activations.csv", STATIC])
def test_one_changed_byte_breaks_the_chain_at_its_file(session: Path, station: Station, name: str) -> None:
    content = bytearray((session / name).read_bytes())
    content[len(content) // 2] ^= 1
    (session / name).write_bytes(content)
    code, links = verified(station, session)
    assert (code, links[name]) == (1, CHANGED)


@pytest.mark.parametrize(
    ("change", "given"),
    [
        (lambda hand: None, ()),
        (lambda hand: hand.update(migration_m=0.02), ("migration",)),
        (lambda hand: hand.update(damping_n_s_per_m=None), ()),
        (lambda hand: hand.pop("sources"), ("stiffness", "damping", "migration")),
    ],
)
def test_a_figure_without_the_fits_standard_error_is_given_by_hand(
    reported: Path, tmp_path: Path, change: Callable[[Any], None], given: tuple[str, ...]
) -> None:
    copy = tmp_path / "cuffs.json"
    copy.write_bytes((reported / "cuffs.json").read_bytes())
    edit(copy, lambda plain: change(plain["cuffs"]["hand"]))
    assert read_cuffs(copy)["hand"].given == given


def test_cuffs_written_by_hand_are_given_and_break_nothing(tmp_path: Path, station: Station) -> None:
    figures = {"stiffness_n_per_m": 4000, "damping_n_s_per_m": {"value": 100}, "migration_m": 0.01}
    (tmp_path / "cuffs.json").write_text(json.dumps({"cuffs": {"hand": figures}}))
    assert read_cuffs(tmp_path / "cuffs.json")["hand"].given == ("stiffness", "damping", "migration")
    code, links = verified(station, tmp_path)
    assert (code, links["cuffs.json, cuff hand"]) == (0, BY_HAND)
    station("report", tmp_path)
    assert "4000 (given by hand)" in (tmp_path / "report.html").read_text(encoding="utf-8")


def test_a_decision_after_the_fit_breaks_nothing(session: Path, station: Station) -> None:
    write_verdict(session, STATIC, "accept", "")
    assert station("verify", session).code == 0


def test_a_folder_with_nothing_to_verify_is_refused(tmp_path: Path, station: Station) -> None:
    assert_refused(station("verify", tmp_path), 1, ChainCode.NOTHING_TO_VERIFY)
    assert_refused(station("verify", tmp_path / "nowhere"), 1, FolderCode.NOT_A_FOLDER)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows keeps its named pipes in no folder")
@pytest.mark.parametrize("name", ["cuffs.json", "report.html", "assessment.json", CHECKSUMS_FILE, STATIC])
def test_a_pipe_in_place_of_a_file_is_refused(session: Path, station: Station, name: str) -> None:
    (session / name).unlink()
    os.mkfifo(session / name)
    assert_refused(station("verify", session), 1, ChainCode.NOT_REGULAR)


def make_key(path: Path) -> Path:
    command = ["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-C", "lab", "-f", str(path)]
    subprocess.run(command, check=True, stdin=subprocess.DEVNULL)  # noqa: S603
    return path


@pytest.fixture
def key(tmp_path: Path) -> Path:
    return make_key(tmp_path / "lab_key")


def allow(tmp_path: Path, key: Path) -> Path:
    """OpenSSH's list of allowed signers with this key in it."""
    signers = tmp_path / "allowed_signers"
    signers.write_text(f"lab@example.org {key.with_suffix('.pub').read_text()}")
    return signers


@needs_ssh_keygen
def test_a_change_with_new_checksums_breaks_the_signature(
    session: Path, tmp_path: Path, key: Path, station: Station
) -> None:
    signers = allow(tmp_path, key)
    ran = station("verify", session, "--sign", key, "--signers", signers)
    assert ran.code == 0, ran.err
    good = 'as recorded (Good "cuffstation" signature for lab@example.org'
    assert ran.out.startswith(f"SHA256SUMS.sig ← SHA256SUMS: {good}")
    command = ["ssh-keygen", "-Y", "verify", "-f", str(signers), "-I", "lab@example.org", "-n", "cuffstation"]
    with (session / CHECKSUMS_FILE).open("rb") as signed:  # without the station, as docs/security.md says
        subprocess.run([*command, "-s", str(session / f"{CHECKSUMS_FILE}.sig")], stdin=signed, check=True)  # noqa: S603
    assert "give --signers" in station("verify", session).out

    replace_trial(session / STATIC)
    write_checksums(session / STATIC)  # as an attacker would
    code, links = verified(station, session, "--signers", signers)
    assert (code, links["SHA256SUMS.sig ← SHA256SUMS"]) == (1, CHANGED)


@needs_ssh_keygen
def test_signers_expect_a_signature_of_their_key(session: Path, tmp_path: Path, key: Path, station: Station) -> None:
    ran = station("verify", session, "--signers", allow(tmp_path, key))
    assert ran.code == 1 and ran.out.startswith("SHA256SUMS.sig ← SHA256SUMS: missing")
    signers, other = allow(tmp_path, key), make_key(tmp_path / "other_key")
    code, links = verified(station, session, "--sign", other, "--signers", signers)
    assert (code, links["SHA256SUMS.sig ← SHA256SUMS"]) == (1, CHANGED)
    assert_refused(station("verify", session, "--signers", tmp_path / "missing"), 1, ChainCode.NO_SIGNERS)


@needs_ssh_keygen
def test_a_file_of_another_program_is_signed_after_it_was_listed(session: Path, key: Path, station: Station) -> None:
    (session / "notes.jsonl").write_text('{"note": "the strap was loose"}\n')  # lines of another program
    assert_refused(station("verify", session, "--sign", key), 1, ChainCode.BROKEN)
    assert not (session / f"{CHECKSUMS_FILE}.sig").exists()
    assert station("verify", session, "--add", session / "notes.jsonl", "--sign", key).code == 0
    assert_refused(station("verify", session, "--add", session / "notes.jsonl"), 1, ChainCode.NOT_ADDED)


@pytest.fixture
def journal(tmp_path: Path) -> Path:
    """Of a session with a plan and decisions, without its recordings."""
    (session := tmp_path / "session").mkdir()
    write_setup(session, Setup("P01", "ab", ("hand",), 3))
    for number in range(1, 5):
        write_mark(session, STATIC, number, f"mark {number}")
    write_verdict(session, STATIC, "accept", "")
    return session / JOURNAL_FILE


def swap(lines: list[bytes]) -> None:
    lines[1], lines[2] = lines[2], lines[1]


def flip(lines: list[bytes]) -> None:
    lines[0] = lines[0].replace(b"P01", b"P77")


EDITS: dict[str, Callable[[list[bytes]], object]] = {
    "reordered": swap,
    "flipped": flip,
    "first deleted": lambda lines: lines.pop(0),
    "deleted": lambda lines: lines.pop(3),
    "last deleted": lambda lines: lines.pop(),
    "duplicated": lambda lines: lines.insert(2, lines[2]),
    "last two deleted": lambda lines: lines.__delitem__(slice(-2, None)),
    "last without its end": lambda lines: lines.append(lines.pop()[:-1]),
    "last cut": lambda lines: lines.append(lines.pop()[:20]),
    "flipped above a line that was begun": lambda lines: (flip(lines), lines.append(b'{"kind"')),
    "last duplicated": lambda lines: lines.append(lines[-1]),
    "inserted": lambda lines: lines.insert(1, b'{"kind": "donned", "at": "", "format": 1, "cuff": "hand"}\n'),
    "appended": lambda lines: lines.append(b'{"kind": "donned", "at": "", "format": 1, "cuff": "hand"}\n'),
    "last changed": lambda lines: lines.append(lines.pop().replace(b"accept", b"redo  ")),
    "all replaced": lambda lines: lines.__setitem__(slice(None), [b"{}\n"]),
}


@pytest.mark.parametrize("name", EDITS)
def test_an_edited_journal_is_changed(journal: Path, station: Station, name: str) -> None:
    lines = journal.read_bytes().splitlines(keepends=True)
    EDITS[name](lines)
    journal.write_bytes(b"".join(lines))
    code, links = verified(station, journal.parent)
    assert (code, links[JOURNAL_FILE]) == (1, CHANGED)


def test_a_reordered_journal_is_found_although_its_hash_was_listed_anew(journal: Path, station: Station) -> None:
    """The line that does not continue those above it is named."""
    lines = journal.read_bytes().splitlines(keepends=True)
    swap(lines)
    journal.write_bytes(b"".join(lines))
    write_checksums(journal)
    found = [link for link in json.loads(station("verify", journal.parent, "--format", "json").out) if link["is_break"]]
    assert [(link["what"], link["code"]) for link in found] == [(JOURNAL_FILE, ChainCode.JOURNAL_ORDER)]
    assert found[0]["detail"] == str(Message(ChainCode.JOURNAL_ORDER, {"file": JOURNAL_FILE, "line": 2}))


def test_a_report_of_an_edited_journal_says_so(session: Path, station: Station) -> None:
    write_setup(session, Setup("P01", "ab", ("hand",), 3))
    journal = session / JOURNAL_FILE
    journal.write_bytes(journal.read_bytes().replace(b"P01", b"P77"))
    ran = station("report", session)
    assert ran.code == 3 and f"{JOURNAL_FILE}: {CHANGED}" in ran.err
    assert '<div class="note" id="doubts">' in (session / "report.html").read_text(encoding="utf-8")


def test_a_journal_may_be_longer_than_its_hash_in_the_list_and_needs_one(journal: Path, station: Station) -> None:
    """The list was not written after the last line, because its computer lost power, or while it wrote another line."""
    listed = (journal.parent / CHECKSUMS_FILE).read_bytes()
    write_mark(journal.parent, STATIC, 5, "after the list")
    (journal.parent / CHECKSUMS_FILE).write_bytes(listed)
    journal.write_bytes(journal.read_bytes() + b'{"kind": "ver')
    code, links = verified(station, journal.parent)
    assert (code, links[JOURNAL_FILE]) == (0, AS_RECORDED)
    (journal.parent / CHECKSUMS_FILE).unlink()
    code, links = verified(station, journal.parent)
    assert (code, links[CHECKSUMS_FILE]) == (1, MISSING)


def test_added_missing_and_changed_files_of_subfolders_are_named(session: Path, station: Station) -> None:
    assert station("export", session / STATIC, "--to", "csv", "--output", session / "tables").code == 0
    (name,) = (path.name for path in (session / "tables").glob("*force*.csv"))
    assert verified(station, session)[1][f"tables/{name}"] == AS_RECORDED
    (session / "tables" / name).rename(session / "tables" / "other.csv")
    (session / "cuff-x_test-static_run-1.mcap").write_bytes(b"")
    in_no_list = (".hidden", "tables/.hidden", ".folder/notes", ".full.lock", ".a.lock/notes", "._folder/notes")
    for hidden in in_no_list:
        (session / hidden).parent.mkdir(exist_ok=True)
        (session / hidden).write_text("added")
    (session / ".capture").write_text("1795000000000000000")
    (session / ".empty.lock").touch()
    for foreign in ("._session.jsonl", ".DS_Store", "tables/Thumbs.db", "desktop.ini"):
        (session / foreign).write_text("of macOS, on a drive without extended attributes, or of Windows")
    (session / ".draft-1").mkdir()
    (session / ".draft-1" / "cuffs.json").write_text("half")
    if os.name != "nt":
        (session / "linked").symlink_to(session.parent)
    code, found = verified(station, session)
    assert found.get("linked", Standing.ADDED) == Standing.ADDED
    assert (code, found[f"tables/{name}"]) == (1, MISSING)
    added = {"tables/other.csv", "cuff-x_test-static_run-1.mcap", *in_no_list}
    assert {name for name, standing in found.items() if standing == Standing.ADDED} - {"linked"} == added


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
@pytest.mark.parametrize(
    "name", [rb"a\b.txt", b"\\", b"new\nline", b"ret\rurn", b"caf\xe9.txt", b" two  spaces ", "α".encode()]
)
def test_a_file_of_any_name_is_listed_as_by_sha256sum(tmp_path: Path, name: bytes) -> None:
    path = Path(os.fsdecode(os.fsencode(tmp_path) + b"/" + name))
    path.write_bytes(b"content")
    record(tmp_path, None)
    assert Checksums(tmp_path).sums[os.fsdecode(name)] == hashlib.sha256(b"content").hexdigest()
    assert not [link for link in verify_folder(tmp_path) if link.standing is not AS_RECORDED]
    if program := shutil.which("sha256sum"):
        subprocess.run([program, "--strict", "-c", CHECKSUMS_FILE], cwd=tmp_path, check=True, capture_output=True)  # noqa: S603
    path.write_bytes(b"changed")
    assert [link.what for link in verify_folder(tmp_path) if link.standing is CHANGED] == [os.fsdecode(name)]


@pytest.mark.parametrize(
    "name", ["", "../elsewhere", "/etc/passwd", "a/../../b", JOURNAL_FILE, 100_000 * "A", 3_000 * "A/"]
)
def test_a_wrong_line_of_the_list_is_named(journal: Path, station: Station, name: str) -> None:
    with (journal.parent / CHECKSUMS_FILE).open("a") as file:
        file.write(f"{'0' * 64}  {name}\n")
    ran = station("verify", journal.parent, "--format", "json")
    broken = [link for link in json.loads(ran.out) if link["is_break"]]
    assert ran.code == 1 and [link["code"] for link in broken] == [ChainCode.LIST_LINE]
