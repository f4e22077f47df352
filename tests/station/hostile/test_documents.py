"""Files made to break or exhaust their reader: every verb ends within its limits with one sentence that names the file,
and keeps the readable part of a recording.
"""

import atexit
import json
import os
import signal
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from documents.message import Message
from documents.plain_data import PlainDataCode
from station.assessment.assessment_file import AssessmentFileError, read_assessment
from station.assessment.assessment_inputs import read_effort
from station.assessment.budget_file import read_budget
from station.config import load_config
from station.emg.emg_json import read_emg_document
from station.emg.trials import read_emg_setup
from station.errors import StationError
from station.messages.assessment_messages import AssessmentFileCode
from station.report.report_file import read_numbers
from station.study.designs import read_study_plan
from station.study.study_document import read_normative
from station.subject.subject_file import SUBJECT_FILE, read_subject
from station.sweep.sweep_plan import read_plan
from tests.recordings.bombs import BOMBS
from tests.station.child_process import end_process
from tests.station.command import Ran, assert_one_sentence, assert_refused

Station = Callable[..., Ran]
DEEP_JSON = "[" * 100_000 + "]" * 100_000
DEEP_TOML = f"a = {DEEP_JSON}\n"
LONG = "7" * 400
"""An integer beyond the range of a double and of a clock."""
JSON_READERS: tuple[Callable[[Path], object], ...] = (read_assessment, read_emg_document, read_numbers, read_normative)
TOML_READERS: tuple[Callable[[Path], object], ...] = (
    load_config,
    read_effort,
    read_budget,
    read_emg_setup,
    read_study_plan,
    read_plan,
    lambda path: read_subject(path.parent),
)
needs_pipes = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows keeps its named pipes in no folder")
GOOD = {"stiffness_n_per_m": 8000, "damping_n_s_per_m": 200, "migration_m": 0.01}
VALID = [("waist_cuff", None), ("waist_cuff", "x"), ("findings", []), ("emg", [])]
EXCESSIVE = ("events", "empty records", "zeros")
"""Correct to the last CRC and too large, so that they are refused as a whole."""
REFUSALS = [
    pytest.param(name, verb, marks=[] if verb == "info" or name == "zeros" else [pytest.mark.slow])
    for name in EXCESSIVE
    for verb in ("info", "recover", "fit", "export")
]
"""By default every bomb is opened once, and every verb opens one."""
MOST_PROCESSOR_S = 10
MOST_MEMORY = 10**9
"""Bytes of its resident set."""
ROOT = Path(__file__).parents[3]


def last_sentence(ran: Ran) -> str:
    """The last line, after those of progress."""
    last = ran.err.splitlines()[-1]
    assert last.startswith("station: ")
    assert "Traceback" not in ran.err
    return last


@pytest.mark.parametrize(
    "text",
    [
        DEEP_JSON,
        '{"cuffs": ' + '{"a":' * 100_000 + "1" + "}" * 100_001,
        f'{{"cuffs": {{"hand": {{"stiffness_n_per_m": {LONG}}}}}}}',
        f'{{"cuffs": {{"hand": {{"stiffness_n_per_m": {LONG * 20}}}}}}}',
        *(
            f'{{"cuffs": {{"hand": {{{wrong}}}}}}}'
            for wrong in (
                '"stiffness_n_per_m": {"value": 1, "parts": [1]}',
                '"stiffness_n_per_m": {"value": 1, "parts": {"noise": "much"}}',
                '"stiffness_n_per_m": {"value": 1, "cramer_rao_bound": []}',
                '"stiffness_n_per_m": "soft"',
                *('"notes": 5', '"notes": [5]', '"sources": [1]', '"sources": {"a.mcap": 1}'),
                *('"not_identified": [1]', '"diagnostics": "none"', '"verdict": {}'),
            )
        ),
        *(f'{{"cuffs": {wrong}}}' for wrong in ('{"../hand": {}}', '{"ha\\u0000nd": {}}', "[1]", "3")),
        "",
        "[]",
    ],
)
@pytest.mark.parametrize("verb", ["assess", "report"])
def test_a_cuffs_file_is_refused_by_name(station: Station, tmp_path: Path, verb: str, text: str) -> None:
    path = tmp_path / "cuffs.json"
    path.write_text(text, encoding="utf-8")
    ran = station("report", tmp_path) if verb == "report" else station("assess", "--cuffs", path, "--output", tmp_path)
    assert_one_sentence(ran, 1, "cuffs.json")
    assert len(ran.err) < 1000


@pytest.mark.parametrize(
    "text", [DEEP_TOML, f"a = {LONG}\n", f"a = {LONG * 20}\n", 'a = "\\u0000"\n', "a = 1979-13-01\n"]
)
def test_every_toml_is_refused_by_name(station: Station, tmp_path: Path, text: str) -> None:
    path = tmp_path / "hostile.toml"
    path.write_text(text, encoding="utf-8")
    cuffs = tmp_path / "cuffs.json"
    cuffs.write_text(json.dumps({"cuffs": {"hand": GOOD}}), encoding="utf-8")
    for code, *words in (
        (2, "check", "--config", path),
        (1, "rmr", "--effort", path, "--output", tmp_path / "a.csv"),
        (2, "emg", tmp_path / "a.csv", "--setup", path, "--output", tmp_path / "out"),
        (1, "sweep", path, "--output", tmp_path / "out"),
        (1, "assess", "--cuffs", cuffs, "--suit", path, "--output", tmp_path),
    ):
        ran = station(*words)
        assert (ran.code, ran.out) == (code, ""), ran.err
        assert "hostile.toml" in last_sentence(ran)


@pytest.mark.parametrize(
    ("content", "code", "readers"),
    [
        (b"{", PlainDataCode.MALFORMED, JSON_READERS + TOML_READERS),
        (b"\xff", PlainDataCode.NOT_TEXT, JSON_READERS + TOML_READERS),
        (DEEP_JSON.encode(), PlainDataCode.TOO_DEEP, JSON_READERS),
        (b"a = " + b"[" * 1000 + b"]" * 1000, PlainDataCode.TOO_DEEP, TOML_READERS),
    ],
    ids=["malformed", "no text", "deep JSON", "deep TOML"],
)
def test_a_refused_document_has_the_code_of_its_cause(
    tmp_path: Path, content: bytes, code: PlainDataCode, readers: Sequence[Callable[[Path], object]]
) -> None:
    path = tmp_path / SUBJECT_FILE
    path.write_bytes(content)
    for read in readers:
        with pytest.raises(StationError) as caught:
            read(path)
        assert isinstance(caught.value.cause, Message)
        assert caught.value.cause.codes == (caught.value.code, code)


def test_a_hostile_protocol_is_refused_with_its_name(station: Station, tmp_path: Path) -> None:
    (tmp_path / "protocol.toml").write_text(DEEP_TOML, encoding="utf-8")
    (tmp_path / "a.mcap").write_bytes(b"x")
    ran = station("fit", tmp_path)
    assert ran.code == 1 and "protocol.toml" in last_sentence(ran)


@pytest.mark.parametrize(
    "text",
    [
        DEEP_TOML,
        "".join(f"k{line}{'.a' * 199} = 1\n" for line in range(600)),
        "k" + ".a" * 100_000 + " = 1\n",
        "k" + '.","' * 60_000 + " = 1\n",
        '[session]\nfile_name = "{run}{test}{cuff:2000000000}"\n',
        '[session]\nfile_name = "{run}{test}{cuff!r:>{run}}"\n',
        "[load_cell]\ncalibrated_on = 9999-12-31\ncalibration_valid_days = 36500\n[daq]\nsample_rate_hz = 0",
    ],
    ids=["deep", "many dots", "dots", "quoted dots", "width", "nested width", "a date that overflows"],
)
def test_a_hostile_configuration_is_refused_within_limits(tmp_path: Path, text: str) -> None:
    path = tmp_path / "hostile.toml"
    path.write_text(text, encoding="utf-8")
    ran = assert_ends_within_limits("check", "--config", path, folder=tmp_path, codes=(2,))
    assert "hostile.toml" in ran.err and ran.err.count("\n") == 1


def _loads(folder: Path, data: str) -> Path:
    path = folder / "loads.xml"
    path.write_text(
        '<OpenSimDocument Version="40000"><ExternalLoads name="a"><objects/>'
        f"<datafile>{data}</datafile></ExternalLoads></OpenSimDocument>",
        encoding="utf-8",
    )
    return path


@needs_pipes
@pytest.mark.parametrize("data", ["/dev/zero", "pipe.sto"])
def test_external_loads_of_a_device_or_a_pipe_are_refused(tmp_path: Path, data: str) -> None:
    os.mkfifo(tmp_path / "pipe.sto")
    output = tmp_path / "a.csv"
    loads = _loads(tmp_path, data)
    ran = assert_ends_within_limits("rmr", "--external-loads", loads, "--output", output, folder=tmp_path, codes=(1,))
    assert "regular file" in ran.err


@needs_pipes
@pytest.mark.parametrize("verb", ["info", "recover"])
def test_a_pipe_is_not_read_as_a_recording(station: Station, tmp_path: Path, verb: str) -> None:
    os.mkfifo(tmp_path / "a.mcap")
    ran = station(verb, tmp_path / "a.mcap")
    assert (ran.code, ran.out) == (1, "") and "a.mcap" in last_sentence(ran)


def test_a_deeply_nested_model_is_refused(station: Station, tmp_path: Path) -> None:
    path = tmp_path / "deep.osim"
    path.write_text("<a>" * 100_000 + "</a>" * 100_000, encoding="utf-8")
    assert_one_sentence(station("rmr", "--model", path, "--output", tmp_path / "a.csv"), 1, "deep.osim, line 1")


def _assessment() -> dict[str, Any]:
    """The smallest assessment that can be reported."""
    known: Any = {"value": 1.0, "ci95": None}
    optimum = dict.fromkeys(("rest_length_m", "normalised_cost", "permissible_error_m"), known)
    by_cuff = {"rigid": known, "hand": {"both": known}}
    return {
        "format": 1,
        **dict.fromkeys(("reference_rest_length_m", "bare_body_cost", "longest_cord_m"), known),
        **{key: {"value": 1} for key in ("frames", "scenarios")},
        "rest_lengths_m": {"value": [0.5, 0.6], "ci95": None},
        "waist_cuff": None,
        "unsolved": {"count": {"value": 0, "ci95": None}},
        "optimum": {"rigid": optimum, "hand": {"both": optimum}},
        "cost": {"rigid": {"value": [1.0, 0.9]}, "hand": {"both": {"value": [1.0, None]}}},
        "muscle_reduction": {"rigid": {"DELT": known}, "hand": {"both": {"DELT": known}}},
        **dict.fromkeys(("at_rigid_optimum", "optimum_to_slack_m", "largest_cord_force_n"), by_cuff),
        **dict.fromkeys((f"cost_per_{end}_migration_per_m" for end in ("arm", "waist")), by_cuff),
        "cord_force_lost_to_migration": by_cuff,
        "inputs": {"model": "bundled", "motion": "m", "suit": "s", "cuffs": "c"},
        "findings": ["the suit helps"],
        "emg": [],
    }


def test_the_smallest_assessment_is_reported(station: Station, tmp_path: Path) -> None:
    (tmp_path / "assessment.json").write_text(json.dumps(_assessment()), encoding="utf-8")
    ran = station("report", tmp_path)
    assert ran.code == 0, ran.err


@pytest.mark.parametrize(
    ("key", "wrong"),
    [
        (key, wrong)
        for key in _assessment()
        for wrong in ("missing", [], {}, "x", 5, None, {"rigid": 1})
        if (key, wrong) not in VALID
    ],
)
def test_an_incomplete_assessment_is_refused(tmp_path: Path, key: str, wrong: Any) -> None:
    plain = _assessment() | {key: wrong}
    if wrong == "missing":
        del plain[key]
    path = tmp_path / "assessment.json"
    path.write_text(json.dumps(plain), encoding="utf-8")
    with pytest.raises(AssessmentFileError) as caught:
        read_assessment(path)
    assert caught.value.code in set(AssessmentFileCode)
    assert key in str(caught.value) and str(path) in str(caught.value)


@pytest.mark.parametrize(
    ("text", "code"),
    [
        *((text, AssessmentFileCode.NOT_AN_OBJECT) for text in ("[]", "5", '"x"')),
        *((text, AssessmentFileCode.NOT_JSON) for text in ("{", DEEP_JSON, f'{{"frames": {LONG}}}')),
        ('{"cost": {}}', AssessmentFileCode.INVALID_ENTRY),
    ],
)
def test_a_malformed_assessment_is_refused(
    station: Station, tmp_path: Path, text: str, code: AssessmentFileCode
) -> None:
    (tmp_path / "assessment.json").write_text(text, encoding="utf-8")
    assert_refused(station("report", tmp_path), 1, code)


@pytest.fixture(scope="module")
def sessions(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A session's folder for each bomb."""
    folders = {name: tmp_path_factory.mktemp("session") for name in BOMBS}
    for name, folder in folders.items():
        BOMBS[name](folder / "a.mcap")
    return folders


@pytest.mark.parametrize(("name", "verb"), REFUSALS)
def test_a_bomb_is_refused_by_every_verb(sessions: dict[str, Path], name: str, verb: str, tmp_path: Path) -> None:
    path = sessions[name] / "a.mcap"
    words: dict[str, tuple[object, ...]] = {
        "info": (path,),
        "recover": (path, "--output", tmp_path / "b.mcap"),
        "fit": (sessions[name],),
        "export": ("--session", sessions[name], "--to", "csv", "--output", tmp_path / "exported"),
    }
    ran = assert_ends_within_limits(verb, *words[verb], folder=tmp_path)
    assert ran.code == 1 and "a.mcap" in ran.err
    assert not (tmp_path / "b.mcap").exists()


@pytest.mark.parametrize("name", [name for name in BOMBS if name not in EXCESSIVE])
def test_the_content_before_a_bomb_is_shown(sessions: dict[str, Path], name: str, tmp_path: Path) -> None:
    ran = assert_ends_within_limits("info", sessions[name] / "a.mcap", folder=tmp_path, codes=(1, 3))
    assert ran.out or "1000000 samples" in ran.err


def run_bounded(*words: object, folder: Path) -> tuple[Ran, int]:
    """Run `station` with these arguments; the memory of its largest resident set [bytes]. It is killed at the limit of
    processor time, and allocations beyond the limit of the address space fail; the time-out of the test ends a run that
    waits.
    """
    if not hasattr(os, "fork"):
        pytest.skip("the limits are those of POSIX: fork and setrlimit")
    (folder / "memory").unlink(missing_ok=True)
    limits = {"processor_s": MOST_PROCESSOR_S, "address_space": 8 * MOST_MEMORY}  # so that the machine survives
    server = _server()
    assert server.stdin is not None and server.stdout is not None
    try:
        server.stdin.write(json.dumps({"words": list(map(str, words)), "folder": str(folder), **limits}) + "\n")
        server.stdin.flush()
        answer = json.loads(server.stdout.readline())
    except BaseException:  # a time-out: the next test must not read this one's answer
        end_process(server)
        _server.cache_clear()
        raise
    texts = [(folder / name).read_text(encoding="utf-8", errors="replace") for name in ("out", "err")]
    return Ran(os.waitstatus_to_exitcode(answer["status"]), *texts), answer["memory"]


@cache
def _server() -> subprocess.Popen[str]:
    """The process that forks one for each run; it ends with its standard input."""
    command, pipe = [sys.executable, "-m", "tests.station.hostile.limited"], subprocess.PIPE
    server = subprocess.Popen(command, stdin=pipe, stdout=pipe, text=True, cwd=ROOT)  # noqa: S603
    atexit.register(end_process, server)
    return server


def assert_ends_within_limits(*words: object, folder: Path, codes: tuple[int, ...] = (1, 2, 3)) -> Ran:
    """The verb ends by itself within the limits, with one of these codes and no traceback."""
    ran, memory = run_bounded(*words, folder=folder)
    assert ran.code != -signal.SIGXCPU, f"{words[0]} took more than {MOST_PROCESSOR_S} s of the processor"
    assert "Traceback" not in ran.err, ran.err[-2000:]
    assert ran.code in codes, (ran.code, ran.err[-500:])
    assert memory < MOST_MEMORY, f"{words[0]} took {memory / 1e6:.0f} MB"
    return ran
