"""Every number of a report is listed with its source, and one that does not follow from it is found and named."""

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from fitting.results.codes import Standing
from station.checksums import Checksums, write_checksums
from station.files.chain import Link, verify_folder
from station.messages.file_messages import NumberCode
from station.report.verification import number_links
from tests.station.reported import DYNAMIC, STATIC, report_session, unmarked_numbers

STIFFNESS = "cuffs.hand.stiffness_n_per_m"
EFFORT = "assessment.at_rigid_optimum.hand.both"
NUMBER = "report.json", "numbers", STIFFNESS
ASSESSED = "report.json", "numbers", EFFORT
FITTED = "cuffs.json", "cuffs", "hand", "stiffness_n_per_m"
SOLVED = "assessment.json", "at_rigid_optimum", "hand", "both"
TRUE = "simulated_truth.hand.migration_m"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return report_session(tmp_path_factory.mktemp("made"), people=2)


@pytest.fixture
def session(made: Path, tmp_path: Path) -> Path:
    """A copy to tamper with."""
    return Path(shutil.copytree(made, tmp_path / "session"))


def edit_json(name: str, *keys: str | int, value: Any) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        plain = json.loads((folder / name).read_text(encoding="utf-8"))
        entry = plain
        for key in keys[:-1]:
            entry = entry[key]
        assert entry[keys[-1]] != value
        entry[keys[-1]] = value
        (folder / name).write_text(json.dumps(plain), encoding="utf-8")

    return edit


def edit_page(pattern: str, replacement: str) -> Callable[[Path], None]:
    def edit(folder: Path) -> None:
        page = (folder / "report.html").read_text(encoding="utf-8")
        edited = re.sub(pattern, replacement, page, count=1)
        assert edited != page
        (folder / "report.html").write_text(edited, encoding="utf-8")

    return edit


def flip_byte(folder: Path) -> None:
    content = bytearray((folder / STATIC).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / STATIC).write_bytes(content)


def cover_up(folder: Path) -> None:
    """Record the hashes of the changed files, as a person does who hides a change."""
    write_checksums(*(folder / name for name in Checksums(folder).sums))


def breaks(folder: Path) -> list[Link]:
    return [link for link in number_links(folder) if link.standing.is_break]


def test_a_report_lists_every_number_of_its_page(made: Path) -> None:
    assert unmarked_numbers(made / "report.html", "session") == []


def test_the_numbers_of_an_unchanged_session_follow_from_their_sources(made: Path) -> None:
    links = list(number_links(made))
    assert {link.standing for link in links} == {Standing.AS_RECORDED}
    assert {link.what.split(" ← ")[1].split(",")[0] for link in links if " ← " in link.what} == {
        "cuffs.json", "assessment.json", "simulated_truth.json", "recordings",
    }  # fmt: skip


def test_a_number_is_as_in_its_source_and_names_what_it_rests_on(made: Path) -> None:
    listed = json.loads((made / "report.json").read_text(encoding="utf-8"))["numbers"]
    cuff = json.loads((made / "cuffs.json").read_text(encoding="utf-8"))["cuffs"]["hand"]["stiffness_n_per_m"]
    stiffness, effort = listed[STIFFNESS], listed[EFFORT]
    assert (stiffness["value"], stiffness["ci95"], stiffness["unit"]) == (cuff["value"], cuff["ci95"], "N/m")
    assert stiffness["recordings"] == effort["recordings"] == [STATIC, DYNAMIC]
    assert stiffness["source"] == {"file": "cuffs.json", "pointer": "/cuffs/hand/stiffness_n_per_m"}
    assert (effort["draws"], effort["seed"]) == (2, 1) and "draws" not in stiffness


@pytest.mark.parametrize(
    ("tamper", "code", "named"),
    [
        (edit_page(rf'(id="{STIFFNESS}"[^>]*>)\d', r"\g<1>9"), NumberCode.PAGE, STIFFNESS),
        (edit_page(rf'(id="{STIFFNESS}" value=")\d', r"\g<1>9"), NumberCode.PAGE, STIFFNESS),
        (edit_page(rf'id="{STIFFNESS}"', 'id="other"'), NumberCode.NOT_ON_PAGE, STIFFNESS),
        (edit_page(r'(<div id="figure\.effort\.1">.*?)\d', r"\1x"), NumberCode.FIGURE, "figure.effort.1"),
        (edit_json(*NUMBER, "text", value="9"), NumberCode.PAGE, STIFFNESS),
        (edit_json(*NUMBER, "value", value=9.0), NumberCode.PAGE, STIFFNESS),
        (edit_json(*NUMBER, "ci95", value=[1.0, 2.0]), NumberCode.SOURCE, STIFFNESS),
        (edit_json(*NUMBER, "source", "pointer", value="/x"), NumberCode.SOURCE, STIFFNESS),
        (edit_json(*NUMBER, "recordings", value=[]), NumberCode.PROVENANCE, STIFFNESS),
        (edit_json(*ASSESSED, "seed", value=2), NumberCode.PROVENANCE, EFFORT),
        (edit_json(*ASSESSED, "source", "pointer", value="/bare_body_cost"), NumberCode.SOURCE, EFFORT),
        (edit_json(*FITTED, "value", value=9.0), NumberCode.SOURCE, STIFFNESS),
        (edit_json(*FITTED, "ci95", value=[1.0, 9.0]), NumberCode.SOURCE, STIFFNESS),
        (edit_json(*SOLVED, "value", value=0.5), NumberCode.SOURCE, EFFORT),
        (edit_json("assessment.json", "findings", 2, value="9 are well."), NumberCode.SOURCE, "assessment.findings.2"),
        (edit_json("simulated_truth.json", "hand", "migration_m", value=0.02), NumberCode.SOURCE, TRUE),
    ],
)
def test_a_changed_number_is_named(session: Path, tamper: Callable[[Path], None], code: NumberCode, named: str) -> None:
    tamper(session)
    cover_up(session)
    found = breaks(session)
    assert code in {link.code for link in found}, found
    assert any(f"{named} " in link.detail for link in found if link.code == code), found


def test_a_changed_byte_of_a_recording_is_found_with_the_numbers_that_rest_on_it(session: Path) -> None:
    flip_byte(session)
    (link,) = breaks(session)
    assert (link.what, link.code) == (f"report.json ← {STATIC}", NumberCode.INPUT)
    assert Standing.CHANGED in {link.standing for link in verify_folder(session) if link.what == STATIC}


def test_a_report_json_that_is_none_is_refused(session: Path) -> None:
    (session / "report.json").write_text('{"format": 1}')
    assert [link.code for link in breaks(session)] == [NumberCode.FILE]


def test_without_a_cuffs_file_the_fitted_numbers_have_nothing_to_compare_with(session: Path) -> None:
    (session / "cuffs.json").unlink()
    standings = {link.what.split(",")[0]: link.standing for link in number_links(session)}
    assert standings["report.json ← cuffs.json"] in (Standing.MISSING, Standing.UNRECORDED)
