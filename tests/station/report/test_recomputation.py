"""The results of a session are computed again from the samples, and a number that does not follow is named."""

import json
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest

from fitting.cuffs.cuffs_file import read_cuffs
from fitting.results.codes import Standing
from station.assessment.assess import assess_cuffs, write_assessment
from station.assessment.assessment_inputs import AssessmentInputs
from station.checksums import write_checksums
from station.files.chain import Link
from station.messages.assessment_messages import AssessmentFileCode
from station.messages.file_messages import NumberCode
from station.messages.setup_messages import FolderCode
from station.report.page import ReportError, read_results, render, write_report
from station.report.recomputation import TOLERANCE, Difference, differences, recomputed_links
from tests.refusals import raises_refusal
from tests.station.command import Station, assert_refused
from tests.station.foreign import static_and_dynamic
from tests.station.reported import DYNAMIC, STATIC

STIFFNESS = "cuffs.hand.stiffness_n_per_m"


@pytest.fixture
def session(reported: Path, tmp_path: Path) -> Path:
    """A copy to tamper with."""
    return Path(shutil.copytree(reported, tmp_path / "session"))


def scaled(value: Any, factor: float) -> Any:
    """A result whose numbers were all changed together, so that no hash and no comparison within it shows it."""
    if isinstance(value, dict):
        return {key: scaled(entry, factor) for key, entry in value.items()}
    if isinstance(value, list):
        return [scaled(entry, factor) for entry in value]
    return factor * value if isinstance(value, float) else value


def edit(path: Path, change: Callable[[Any], object]) -> Path:
    plain = json.loads(path.read_text(encoding="utf-8"))
    change(plain)
    path.write_text(json.dumps(plain), encoding="utf-8")
    return path


def by_what(links: Iterable[Link]) -> dict[str, Link]:
    return {link.what.split(",")[0]: link for link in links}


def test_verify_computes_the_same_numbers_again_on_request(reported: Path, station: Station) -> None:
    again = [
        "cuffs.json ← fit of the recordings",
        "report.json ← fit of the recordings",
        "assessment.json ← the model",
        "report.json ← the model",
    ]
    ran = station("verify", reported, "--recompute", "--format", "json")
    links = [link for link in json.loads(ran.out) if link["what"].split(",")[0] in again]
    assert [link["what"].split(",")[0] for link in links] == again
    assert {link["standing"] for link in links} == {Standing.AS_RECORDED}
    assert "fit of the recordings" not in station("verify", reported).out


def test_a_result_whose_every_hash_was_written_again_does_not_follow_from_the_samples(session: Path) -> None:
    write_checksums(edit(session / "cuffs.json", lambda plain: plain.update(cuffs=scaled(plain["cuffs"], 1.01))))
    link = by_what(recomputed_links(session))["cuffs.json ← fit of the recordings"]
    assert (link.standing, link.code) == (Standing.CHANGED, NumberCode.RECOMPUTED)
    assert link.detail.startswith("/cuffs/hand/stiffness_n_per_m/value ")


def test_another_recording_is_no_source_and_an_older_sentence_breaks_nothing(session: Path) -> None:
    (session / STATIC).unlink()
    static_and_dynamic(4)[0].record(session / STATIC)
    edit(session / "assessment.json", lambda plain: plain["findings"].__setitem__(0, "An older station said so."))
    links = by_what(recomputed_links(session))
    link = links["report.json ← fit of the recordings"]
    assert link.code == NumberCode.RECOMPUTED and STIFFNESS in link.detail
    link = links["assessment.json ← the model"]
    assert link.standing == Standing.UNRECORDED and link.detail.endswith("/findings/0")


def test_numbers_of_a_report_without_a_cuffs_file_follow_from_the_samples(session: Path) -> None:
    for name in ("cuffs.json", "assessment.json", "activations.csv"):
        (session / name).unlink()
    write_report(session)
    (link,) = recomputed_links(session)
    assert link.what.startswith("report.json ← fit of the recordings") and link.standing == Standing.AS_RECORDED


@pytest.mark.parametrize("cutoff_hz", [pytest.param(None, marks=pytest.mark.slow), 1.0])
def test_an_assessment_is_computed_again_with_its_own_filter(session: Path, cutoff_hz: float | None) -> None:
    inputs = AssessmentInputs(session / "cuffs.json", cutoff_hz=cutoff_hz)
    assessed = assess_cuffs(read_cuffs(inputs.cuffs), inputs, most_frames=4, most_rest_lengths=5)
    write_assessment(assessed, session)
    write_report(session)
    assert by_what(recomputed_links(session))["assessment.json ← the model"].standing == Standing.AS_RECORDED


@pytest.mark.parametrize(("read", "file"), [("effort", "effort.toml"), ("motion", "raise.mot")])
def test_an_assessment_with_a_file_from_elsewhere_is_not_computed_again(session: Path, read: str, file: str) -> None:
    edit(session / "assessment.json", lambda plain: plain["inputs"].update({read: f"{file} {64 * 'a'}"}))
    assert by_what(recomputed_links(session))["assessment.json ← the model"].standing == Standing.UNRECORDED


@pytest.mark.parametrize(
    ("text", "code"), [("{", AssessmentFileCode.NOT_JSON), ('{"format": 1}', AssessmentFileCode.INVALID_ENTRY)]
)
def test_an_assessment_that_cannot_be_read_does_not_follow(tmp_path: Path, text: str, code: AssessmentFileCode) -> None:
    (tmp_path / "assessment.json").write_text(text, encoding="utf-8")
    (link,) = recomputed_links(tmp_path)
    assert (link.standing, link.code) == (Standing.CHANGED, code)


@pytest.mark.parametrize("file", ["simulated_truth.json", "missing.json"])
@pytest.mark.parametrize("content", [b'["a", 7]', b"{", b"\xff"])
def test_a_file_beside_the_recordings_that_cannot_be_used_is_refused(session: Path, file: str, content: bytes) -> None:
    (session / file).write_bytes(content)
    with raises_refusal(FolderCode.FILE_BESIDE_UNUSABLE, file, kind=ReportError):
        render(read_results(session))


def test_differences_are_named_by_their_json_pointer() -> None:
    found = {"a/b": [1.0, {"c": 2.0}], "d": "x", "same": 3}
    expected = {"a/b": [1.0, {"c": 2.0 * (1 + 1e-3)}], "d": "y", "same": 3.0, "later": 4}
    numeric, text = differences(found, expected)
    assert (numeric.pointer, text.pointer) == ("/a~1b/1/c", "/d")
    assert numeric.size == pytest.approx(1e-3, rel=1e-2) and numeric.size > TOLERANCE
    assert text.size == Difference("", 1.0, None).size == float("inf")


def test_one_number_is_followed_to_its_samples(reported: Path, station: Station) -> None:
    ran = station("verify", reported, "--number", STIFFNESS, "--format", "json")
    chain = json.loads(ran.out)
    assert ran.code == 0 and chain["faults"] == [] and chain["source_standing"] == Standing.AS_RECORDED
    assert [recording["file"] for recording in chain["recordings"]] == [STATIC, DYNAMIC]
    for recording, truth in zip(chain["recordings"], static_and_dynamic(), strict=True):
        samples = {stream["name"]: stream["samples"] for stream in recording["streams"]}
        assert samples == {name: len(track.values) for name, track in truth.tracks.items()}
    assert STATIC in station("verify", reported, "--number", STIFFNESS).out


def test_a_number_that_does_not_follow_and_an_unknown_one_have_code_1(session: Path, station: Station) -> None:
    page = (session / "report.html").read_text(encoding="utf-8")
    (session / "report.html").write_text(page.replace(f'id="{STIFFNESS}"', 'id="x"'), encoding="utf-8")
    ran = station("verify", session, "--number", STIFFNESS)
    assert ran.code == 1 and NumberCode.NOT_ON_PAGE in ran.out
    assert_refused(station("verify", session, "--number", "none"), 1, NumberCode.UNKNOWN)
