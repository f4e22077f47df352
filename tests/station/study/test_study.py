"""A study of many sessions, and the plan of one: figures, document, page and refusals."""

import json
import math
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from pydantic import ValidationError

from documents.message import Message
from fitting.results.codes import NoteCode, Verdict
from fitting.results.cuffs_schema import FigureEntry, NoteEntry
from fitting.study.cuff_study import ComparisonOutcome, ReliabilityOutcome, StudyOutcome
from fitting.study.variance_components import ComponentOutcome
from station.charts.marks import Strip
from station.checksums import file_sha256
from station.config import load_config
from station.messages.setup_messages import FolderCode
from station.messages.study_messages import PlanCode, StudyCode
from station.study.designs import DesignOutcome, find_designs, planned_config, read_study_plan, session_minutes
from station.study.sessions import StudyError, read_session, read_sessions, select_measurements
from station.study.study_document import NormativePlace, StudyDocument, make_study, read_normative
from station.study.study_page import forest_chart
from tests.refusals import raises_refusal
from tests.station.command import Station, assert_refused
from tests.station.study.synthetic_sessions import CUFF_FACTORS, STIFFNESS, write_sessions

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "station.toml"
EXAMPLE = re.findall(r"^```toml\n(.*?)^```", (ROOT / "docs" / "study.md").read_text(encoding="utf-8"), re.M | re.S)[0]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    write_sessions(folder, 8)
    return folder


@pytest.fixture(scope="module")
def document(folder: Path) -> StudyDocument:
    return make_study(read_sessions([folder]))


def test_components_and_differences_are_those_that_the_sessions_were_drawn_with(document: StudyDocument) -> None:
    components = document.cuffs["tube"]["stiffness"].components
    for name in ("volunteer", "donning", "repeat"):
        low, high = components[name].sd.ci95 or (None, None)
        assert low is not None and high is not None
        assert low <= getattr(STIFFNESS, name) <= high
    assert document.cuffs["tube"]["stiffness"].noise_sd == pytest.approx(STIFFNESS.noise)
    migration = document.cuffs["tube"]["migration"]
    assert migration.repeats == 1
    assert migration.components["repeat"].outcome is ComponentOutcome.CONFOUNDED
    assert migration.components["repeat"].confounded_with == ("donning",)
    (found,) = [one for one in document.comparisons if one.quantity == "stiffness"]
    assert (found.first, found.second, found.volunteers) == ("hand", "tube", 8)
    expected = STIFFNESS.mean * (CUFF_FACTORS["tube"] - CUFF_FACTORS["hand"])
    assert found.difference.ci95[0] <= expected <= found.difference.ci95[1]


def test_a_figure_that_is_not_finite_is_refused_by_the_document(document: StudyDocument) -> None:
    broken = replace(document.cuffs["tube"]["stiffness"], noise_sd=math.nan)
    with pytest.raises(ValidationError, match="finite"):
        StudyDocument(**{**dict(document), "cuffs": {"tube": {"stiffness": broken}}})


def test_another_file_is_no_study_and_no_normative_table(tmp_path: Path) -> None:
    (tmp_path / "other.json").write_text(other := '{"format": 2}', encoding="utf-8")
    with pytest.raises(ValidationError):
        StudyDocument.model_validate_json(other)
    with raises_refusal("normative.wrong_file", kind=StudyError):
        read_normative(tmp_path / "other.json")


def test_the_verb_writes_study_table_and_page(folder: Path, tmp_path: Path, station: Station) -> None:
    ran = station("study", folder, "--output", tmp_path)
    assert ran.code == 0, ran.err
    written = StudyDocument.model_validate_json((tmp_path / "study.json").read_bytes())
    normative = read_normative(tmp_path / "normative.json")
    entry, found = normative.cuffs["hand"]["stiffness"], written.cuffs["hand"]["stiffness"]
    assert normative.study_sha256 == file_sha256(tmp_path / "study.json")
    assert entry.prediction95 == found.prediction.ci95
    assert [entry.place(value) for value in (entry.prediction95[0] - 1, entry.mean, entry.prediction95[1] + 1)] == [
        *NormativePlace
    ]
    page = (tmp_path / "study.html").read_text(encoding="utf-8")
    assert page.count("<svg") > 6
    assert "P01" in page


def test_one_volunteer_one_operator_and_one_repeat_have_outcomes(tmp_path: Path) -> None:
    write_sessions(tmp_path, 1, operators=1, donnings=3, repeats=1)
    found = make_study(read_sessions([tmp_path])).cuffs["hand"]["stiffness"]
    assert found.outcome is StudyOutcome.ONE_VOLUNTEER
    assert found.reliability.outcome is ReliabilityOutcome.ONE_VOLUNTEER
    assert found.components["operator"].outcome is ComponentOutcome.ONE_LEVEL
    assert found.components["volunteer"].outcome is ComponentOutcome.ONE_LEVEL
    assert found.prediction is None


def test_one_donning_is_too_little_and_one_volunteer_no_comparison(tmp_path: Path, station: Station) -> None:
    write_sessions(tmp_path, 1, operators=1, donnings=1, repeats=1)
    found = make_study(read_sessions([tmp_path]))
    assert found.cuffs["hand"]["stiffness"].outcome is StudyOutcome.TOO_FEW
    assert {one.outcome for one in found.comparisons} == {ComparisonOutcome.FEW_COMMON}
    station("study", tmp_path, "--output", tmp_path / "study")
    page = (tmp_path / "study" / "study.html").read_text(encoding="utf-8")
    assert "standard deviation [" not in page, "no table without a row"


def test_sessions_and_donnings_that_cannot_be_used_are_listed_by_code(folder: Path, tmp_path: Path) -> None:
    copied = tmp_path / "sessions"
    shutil.copytree(folder, copied)
    first, second, third, fourth = sorted(copied.iterdir())[:4]
    (first / "cuffs.json").unlink()
    (second / "session.jsonl").unlink()
    (third / "cuffs.json").write_text("{", encoding="utf-8")
    cuffs = json.loads((fourth / "cuffs.json").read_text(encoding="utf-8"))
    donning = cuffs["cuffs"]["hand"]["donnings"]["1"]
    donning["damping_n_s_per_m"]["value"], donning["verdict_codes"] = None, ["damping_not_identified.lag"]
    (fourth / "cuffs.json").write_text(json.dumps(cuffs), encoding="utf-8")
    made = make_study(read_sessions([copied]))
    assert [entry.code.value for entry in made.left_out] == [
        "study.session_not_fitted",
        "study.no_journal",
        "study.session_unreadable",
        "study.not_identified",
    ]
    assert made.left_out[-1].figures["reason_code"] == Verdict.LAG
    assert len(made.sessions) == 13


def test_a_trial_that_ended_early_is_the_reason_for_a_missing_value_with_its_figures(folder: Path) -> None:
    session = read_session(sorted(folder.iterdir())[0])
    assert not isinstance(session, Message)
    note = NoteEntry(code=NoteCode.STOPPED_LOADING, figures={"repeat": 2.0, "count": 3.0, "total": 5.0})
    changes = {
        "stiffness_n_per_m": FigureEntry(),
        "verdict_codes": [Verdict.FEW_LOADS],
        "note_codes": [note],
        "donnings": {},
    }
    cuffs = {"hand": session.cuffs.cuffs["hand"].model_copy(update=changes)}
    shortened = replace(session, cuffs=session.cuffs.model_copy(update={"cuffs": cuffs}))
    _, (left_out,) = select_measurements(shortened, "stiffness")
    assert left_out.figures["reason_code"] == NoteCode.STOPPED_LOADING
    assert left_out.figures["reason"] == NoteCode.STOPPED_LOADING.sentence(left_out.figures)


@pytest.mark.parametrize(("verdict", "reason"), [("from a data sheet", "from a data sheet"), ("", "no value")])
def test_the_reason_of_a_cuff_written_by_hand_is_its_verdict_as_written(
    folder: Path, verdict: str, reason: str
) -> None:
    session = read_session(sorted(folder.iterdir())[0])
    assert not isinstance(session, Message)
    changes = {"damping_n_s_per_m": FigureEntry(), "verdict_codes": [], "verdict": verdict, "donnings": {}}
    cuffs = {"hand": session.cuffs.cuffs["hand"].model_copy(update=changes)}
    _, (left_out,) = select_measurements(
        replace(session, cuffs=session.cuffs.model_copy(update={"cuffs": cuffs})), "damping"
    )
    assert left_out.figures["reason"] == reason
    assert "reason_code" not in left_out.figures


def test_measured_and_simulated_sessions_are_not_mixed(tmp_path: Path) -> None:
    folders = [tmp_path / origin for origin in ("measured", "simulated")]
    for folder in folders:
        write_sessions(folder, 1, operators=1, origin=folder.name)
    with raises_refusal(StudyCode.MIXED_ORIGIN, kind=StudyError):
        read_sessions(folders)


def test_a_folder_without_sessions_is_refused(tmp_path: Path, station: Station) -> None:
    for given, code in ((tmp_path, StudyCode.NO_SESSION), (tmp_path / "missing", FolderCode.NOT_A_FOLDER)):
        assert_refused(station("study", given, "--output", tmp_path / "out"), 1, code)
    assert not (tmp_path / "out").exists()


def test_sessions_that_cannot_be_used_are_refused_with_what_each_lacks(tmp_path: Path) -> None:
    first, second, third = write_sessions(tmp_path, 3, operators=1)
    for session in (first, second):
        (session / "session.jsonl").unlink()
    (third / "cuffs.json").unlink()
    with raises_refusal(StudyCode.NO_USABLE_SESSION, kind=StudyError) as refused:
        read_sessions([tmp_path])
    assert [session.name in str(refused.value) for session in (first, second, third)] == [True, True, True]


def test_a_journal_without_a_code_is_not_said_to_be_missing(tmp_path: Path) -> None:
    (session,) = write_sessions(tmp_path, 1, operators=1)
    for journal, code in (("", StudyCode.NO_VOLUNTEER), (None, StudyCode.NO_JOURNAL)):
        path = session / "session.jsonl"
        path.unlink() if journal is None else path.write_text(journal, encoding="utf-8")
        found = read_session(session)
        assert isinstance(found, Message) and found.code == code


def test_the_page_says_why_there_is_no_reliability_and_has_units(tmp_path: Path, station: Station) -> None:
    write_sessions(tmp_path / "sessions", 3, operators=1, donnings=1, repeats=2)
    write_sessions(tmp_path / "sessions" / "unfitted", 1, operators=1)[0].joinpath("cuffs.json").unlink()
    assert station("study", tmp_path / "sessions", "--output", tmp_path).code == 3
    page = (tmp_path / "study.html").read_text(encoding="utf-8")
    assert "<td>no repeated donnings" in page
    assert "difference [N s/m]" in page and "standard deviation [mm] between" in page
    assert "<code>station fit</code>" in page
    assert not re.search(r">-\d|\(-\d| -\d", page.split("<body>")[1].replace("viewBox", ""))


def test_the_bands_of_a_forest_plot_have_colours_of_their_own(document: StudyDocument) -> None:
    ((panel,),) = forest_chart(document.cuffs["hand"]["stiffness"], "stiffness").columns
    assert [mark.colour for mark in panel.marks if isinstance(mark, Strip)] == ["quiet", "c1"]


def test_two_volunteers_have_an_interval_with_one_degree_of_freedom(tmp_path: Path) -> None:
    """Also where the variance between them is estimated as zero."""
    write_sessions(tmp_path, 2, operators=1)
    for found in make_study(read_sessions([tmp_path])).cuffs["tube"].values():
        assert found.mean is not None and found.prediction is not None
        assert (found.mean.dof, found.prediction.dof) == (1.0, 1.0)


@pytest.fixture
def example(tmp_path: Path) -> Path:
    path = tmp_path / "plan.toml"
    path.write_text(EXAMPLE, encoding="utf-8")
    return path


def test_the_recommended_design_reaches_the_power_in_the_least_time(example: Path) -> None:
    """More donnings need fewer volunteers and longer sessions."""
    plan = read_study_plan(example)
    first, *others = find_designs(plan)
    assert first.outcome is DesignOutcome.REACHED
    assert first.power >= plan.detect.power
    assert len(others) == 3 * 3 * 2 * 3 - 1
    assert first.total_hours <= min(one.total_hours for one in others)
    by_donnings = {one.donnings: one for one in (first, *others) if one.repeats == 1}
    assert by_donnings[3].volunteers < by_donnings[1].volunteers
    assert by_donnings[3].session_minutes > by_donnings[1].session_minutes
    # 30 min, and for each of two cuffs one donning of 5 min, 11 holds of 7 s, a swing of 28 s, a pause of 60 s.
    assert session_minutes(read_study_plan(example), 1, 1, 5) == pytest.approx(30 + 2 * (5 + (77 + 28 + 60) / 60))


def test_the_console_reads_the_written_protocol(example: Path, tmp_path: Path, station: Station) -> None:
    ran = station("plan", example, "--output", tmp_path / "planned", "--config", CONFIG)
    assert ran.code == 0, ran.err
    best = json.loads((tmp_path / "planned" / "plan.json").read_text(encoding="utf-8"))["designs"][0]
    planned, before = load_config(tmp_path / "planned" / "station.toml"), load_config(CONFIG)
    assert planned.protocol.repeats == best["repeats"]
    assert list(planned.protocol.step_masses_kg) == best["step_masses_kg"]
    assert planned.model_copy(update={"protocol": before.protocol}) == before


def test_the_protocol_alone_is_replaced_also_of_a_windows_editor(example: Path, tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8")
    before, after = text[: text.index("[protocol]")], text[text.index("[bounce]") :]
    plan = read_study_plan(example)
    best = find_designs(plan)[0]

    def planned(text: str, **form: str) -> str:
        config = tmp_path / "station.toml"
        config.write_text(text, **{"encoding": "utf-8", "newline": "\n"} | form)
        return planned_config(config, plan, best)

    for protocol in ("[protocol]\nrepeats = 1\n", "[protocol]\n# repeats = 1\n\n# [body]\n# pose_s = 5.0\n"):
        found = planned(f"{before}{after}\n{protocol}")
        assert found.count("[protocol]") == 1
        assert ("# [body]\n# pose_s = 5.0" in found) == ("body" in protocol)
    begins_with_it = text[text.index("[protocol]") :]
    assert planned(begins_with_it, encoding="utf-8-sig", newline="\r\n") == planned(begins_with_it)


def test_a_difference_that_is_too_small_has_an_outcome(example: Path, tmp_path: Path, station: Station) -> None:
    example.write_text(EXAMPLE.replace("difference = 20", "difference = 0.1"), encoding="utf-8")
    ran = station("plan", example, "--output", tmp_path / "planned", "--config", CONFIG)
    assert ran.code == 3
    designs = json.loads((tmp_path / "planned" / "plan.json").read_text(encoding="utf-8"))["designs"]
    assert {one["outcome"] for one in designs} == {"power_not_reached"}
    assert designs[0]["power"] == max(one["power"] for one in designs)


@pytest.mark.parametrize(
    ("found", "written", "code"),
    [
        ("[spread]", "[spread", PlanCode.UNREADABLE),
        ("donning = 12", "donings = 12", PlanCode.WRONG_TABLE),
        ("difference = 20", "difference = 0", PlanCode.WRONG_TABLE),
        ("hold_s = 7", "hold_s = 1", PlanCode.WRONG_TABLE),
        ("repeats = [1, 2, 3]", f"repeats = {[*range(1, 101)] * 2}", PlanCode.TOO_MANY_DESIGNS),
    ],
)
def test_a_plan_that_cannot_be_used_is_refused_by_code_and_nothing_is_written(
    found: str, written: str, code: PlanCode, example: Path, tmp_path: Path, station: Station
) -> None:
    example.write_text(EXAMPLE.replace(found, written), encoding="utf-8")
    assert_refused(station("plan", example, "--output", tmp_path / "planned", "--config", CONFIG), 1, code)
    assert not (tmp_path / "planned").exists()


def test_a_config_without_a_protocol_is_refused(example: Path, tmp_path: Path, station: Station) -> None:
    (tmp_path / "other.toml").write_text("[daq]\n", encoding="utf-8")
    ran = station("plan", example, "--output", tmp_path / "planned", "--config", tmp_path / "other.toml")
    assert_refused(ran, 1, PlanCode.NO_PROTOCOL)
