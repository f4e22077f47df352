from __future__ import annotations

import json
import re
from collections.abc import Callable
from pathlib import Path

import pytest

from station.config import load_config
from station.messages.study_messages import PlanCode
from station.study.designs import DesignOutcome, find_designs, planned_config, read_study_plan, session_minutes
from tests.station.command import Ran, assert_refused

ROOT = Path(__file__).parents[3]
CONFIG = ROOT / "station.toml"
EXAMPLE = re.findall(r"^```toml\n(.*?)^```", (ROOT / "docs" / "study.md").read_text(encoding="utf-8"), re.M | re.S)[0]


@pytest.fixture
def example(tmp_path: Path) -> Path:
    path = tmp_path / "plan.toml"
    path.write_text(EXAMPLE, encoding="utf-8")
    return path


def test_the_recommended_design_reaches_the_power_in_the_least_time(example: Path) -> None:
    plan = read_study_plan(example)
    first, *others = find_designs(plan)
    assert first.outcome is DesignOutcome.REACHED
    assert first.power >= plan.detect.power
    assert len(others) == 3 * 3 * 2 * 3 - 1
    assert first.total_hours <= min(one.total_hours for one in others)


def test_more_donnings_need_fewer_volunteers_and_longer_sessions(example: Path) -> None:
    designs = find_designs(read_study_plan(example))
    by_donnings = {one.donnings: one for one in designs if one.repeats == 1}
    assert by_donnings[3].volunteers < by_donnings[1].volunteers
    assert by_donnings[3].session_minutes > by_donnings[1].session_minutes


def test_a_session_takes_the_time_of_its_parts(example: Path) -> None:
    """30 min, and for each of two cuffs one donning of 5 min, 11 holds of 7 s, a swing of 28 s, a pause of 60 s."""
    assert session_minutes(read_study_plan(example), 1, 1, 5) == pytest.approx(30 + 2 * (5 + (77 + 28 + 60) / 60))


def test_the_console_reads_the_protocol_that_is_written(
    example: Path, tmp_path: Path, station: Callable[..., Ran]
) -> None:
    ran = station("plan", example, "--output", tmp_path / "planned", "--config", CONFIG)
    assert ran.code == 0, ran.err
    best = json.loads((tmp_path / "planned" / "plan.json").read_text(encoding="utf-8"))["designs"][0]
    planned, before = load_config(tmp_path / "planned" / "station.toml"), load_config(CONFIG)
    assert planned.protocol.repeats == best["repeats"]
    assert list(planned.protocol.step_masses_kg) == best["step_masses_kg"]
    assert planned.model_copy(update={"protocol": before.protocol}) == before


@pytest.mark.parametrize(
    "protocol", ["[protocol]\nrepeats = 1\n", "[protocol]\n# repeats = 1\n\n# [body]\n# pose_s = 5.0\n"]
)
def test_the_protocol_is_replaced_and_what_follows_it_is_kept(protocol: str, example: Path, tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8")
    start, end = text.index("[protocol]"), text.index("[bounce]")
    config = tmp_path / "station.toml"
    config.write_text(text[:start] + text[end:] + "\n" + protocol, encoding="utf-8")
    plan = read_study_plan(example)
    planned = planned_config(config, plan, find_designs(plan)[0])
    assert planned.count("[protocol]") == 1
    assert ("# [body]\n# pose_s = 5.0" in planned) == ("body" in protocol)


def test_a_configuration_of_a_windows_editor_is_planned_like_another(example: Path, tmp_path: Path) -> None:
    text = CONFIG.read_text(encoding="utf-8")
    edited = tmp_path / "station.toml"
    edited.write_text(text[text.index("[protocol]") :], encoding="utf-8-sig", newline="\r\n")
    plain = tmp_path / "plain.toml"
    plain.write_text(text[text.index("[protocol]") :], encoding="utf-8", newline="\n")
    plan = read_study_plan(example)
    best = find_designs(plan)[0]
    assert planned_config(edited, plan, best) == planned_config(plain, plan, best)


def test_a_difference_that_is_too_small_has_an_outcome_and_an_exit_code(
    example: Path, tmp_path: Path, station: Callable[..., Ran]
) -> None:
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
    found: str, written: str, code: PlanCode, example: Path, tmp_path: Path, station: Callable[..., Ran]
) -> None:
    example.write_text(EXAMPLE.replace(found, written), encoding="utf-8")
    assert_refused(station("plan", example, "--output", tmp_path / "planned", "--config", CONFIG), 1, code)
    assert not (tmp_path / "planned").exists()


def test_a_configuration_without_a_protocol_is_refused(
    example: Path, tmp_path: Path, station: Callable[..., Ran]
) -> None:
    (tmp_path / "other.toml").write_text("[daq]\n", encoding="utf-8")
    ran = station("plan", example, "--output", tmp_path / "planned", "--config", tmp_path / "other.toml")
    assert_refused(ran, 1, PlanCode.NO_PROTOCOL)
