"""The plan: what it spells out, what a sample draws, and a sentence for what it cannot mean."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from station.sweep.plan import PlanError, read_plan
from tests.station.command import assert_one_sentence
from tests.station.sweep.plans import write_plan


def test_a_grid_has_every_combination_in_the_order_of_the_axes(tmp_path: Path) -> None:
    plan = read_plan(write_plan(tmp_path, 'rest_length_m = [0.7, 0.74]\ncondition = ["rigid", "both"]'))
    points = [(p["rest_length_m"], p["cuff"], p["condition"]) for p in plan.points()]
    assert points == [(r, c, k) for r in (0.7, 0.74) for c in ("hand", "elbow") for k in ("rigid", "both")]


def test_what_is_not_named_is_as_it_comes_with_the_station(tmp_path: Path) -> None:
    first, *others = read_plan(write_plan(tmp_path)).points()
    assert (first["model"], first["motion"], first["external_loads"], first["suit"]) == (
        *["bundled"] * 2,
        "none",
        "bundled",
    )
    assert [p["condition"] for p in (first, *others)] == ["rigid", "shift", "visco_elastic", "both"] * 2
    assert "rest_length_m" not in first


@pytest.mark.parametrize("method", ["latin_hypercube", "random"])
def test_a_sample_is_drawn_from_its_spans_and_its_seed_alone(tmp_path: Path, method: str) -> None:
    vary = (
        "rest_length_m = { first = 0.6, last = 0.8 }\nstiffness_n_per_m = 500\n"
        "arm_point_m = { first = [0, -0.2, 0], last = [0, -0.1, 0.01] }"
    )
    head = f'method = "{method}"\ncount = 50\nseed = {{}}\n'
    drawn = list(read_plan(write_plan(tmp_path, vary, head.format(3))).points())
    lengths = np.array([p["rest_length_m"] for p in drawn])
    places = np.array([p["arm_point_m"] for p in drawn])
    assert len(drawn) == 50
    assert 0.6 <= lengths.min() < 0.62 and 0.78 < lengths.max() <= 0.8
    assert (places >= [0, -0.2, 0]).all() and (places <= [0, -0.1, 0.01]).all()
    assert {p["cuff"] for p in drawn} == {"hand", "elbow"}
    assert {p["stiffness_n_per_m"] for p in drawn} == {500.0}
    assert drawn == list(read_plan(write_plan(tmp_path, vary, head.format(3))).points())
    assert drawn != list(read_plan(write_plan(tmp_path, vary, head.format(4))).points())


def test_a_latin_hypercube_has_one_point_in_every_part_of_a_span(tmp_path: Path) -> None:
    vary = "rest_length_m = { first = 0.6, last = 0.8 }"
    plan = read_plan(write_plan(tmp_path, vary, 'method = "latin_hypercube"\ncount = 20\n'))
    shares = (np.array([float(str(p["rest_length_m"])) for p in plan.points()]) - 0.6) / 0.2
    assert sorted((shares * 20).astype(int)) == list(range(20))


@pytest.mark.parametrize(
    ("vary", "head", "sentence"),
    [
        ("rest_length = 0.7", "", "unknown key vary.rest_length"),
        ("", "evry = 3\n", "unknown key evry"),
        ("", "every = 0\n", "every is 0, expected a number of at least 1"),
        ("", 'method = "sobol"\n', "method is 'sobol', expected 'grid', 'latin_hypercube' or 'random'"),
        ("", 'method = "random"\n', "a random sample needs count"),
        ("rest_length_m = -0.7", "", "vary.rest_length_m is -0.7, expected a number above 0"),
        ('rest_length_m = "long"', "", "vary.rest_length_m is 'long', expected a number"),
        ("stiffness_n_per_m = 0", "", "vary.stiffness_n_per_m is 0, expected a number above 0"),
        ("hand_mass_kg = -1", "", "vary.hand_mass_kg is -1, expected a number of at least 0"),
        ("arm_point_m = [0.0, 0.1, nan]", "", "vary.arm_point_m.2 is nan, expected a finite number"),
        ("rest_length_m = []", "", "vary.rest_length_m should have a value and is empty"),
        ("rest_length_m = { first = 0.6, last = 0.8 }", "", "numbers of a sample have first and last"),
        ("arm_point_m = [0.0, 0.1]", "", "vary.arm_point_m.2 is missing"),
        ('condition = "loose"', "", "vary.condition is 'loose', expected 'rigid', 'shift', 'visco_elastic' or 'both'"),
        ("model = 3", "", "vary.model is 3, expected a text"),
        ("model = ", "", "should be a plan in TOML and cannot be read"),
    ],
)
def test_a_plan_that_cannot_be_swept_is_one_sentence(tmp_path: Path, vary: str, head: str, sentence: str) -> None:
    with pytest.raises(PlanError, match=sentence):
        read_plan(write_plan(tmp_path, vary, head))


def test_a_plan_without_cuffs_and_one_that_is_not_there_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "bare.toml").write_text("[vary]\n", encoding="utf-8")
    with pytest.raises(PlanError, match=r"vary\.cuffs is missing"):
        read_plan(tmp_path / "bare.toml")
    (tmp_path / "empty.toml").write_text("", encoding="utf-8")
    with pytest.raises(PlanError, match="vary is missing"):
        read_plan(tmp_path / "empty.toml")
    with pytest.raises(PlanError, match="cannot be read"):
        read_plan(tmp_path / "none.toml")


def test_the_plans_in_the_docs_are_plans(tmp_path: Path) -> None:
    docs = (Path(__file__).parents[3] / "docs" / "sweep.md").read_text(encoding="utf-8")
    grid, sample = (block.split("```")[0] for block in docs.split("```toml\n")[1:])
    points = []
    for text in (grid, sample):
        (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
        points.append(list(read_plan(tmp_path / "plan.toml").points()))
    assert [len(each) for each in points] == [2 * 2 * 2 * 3 * 2 * 2 * 2 * 2, 500]


def test_a_plan_that_cannot_be_swept_ends_the_verb_with_one_sentence(station, tmp_path: Path) -> None:
    plan = write_plan(tmp_path, "rest_length_m = -1")
    assert_one_sentence(
        station("sweep", plan, "--output", tmp_path / "out"), 1, "rest_length_m is -1, expected a number above 0"
    )
    assert not (tmp_path / "out").exists()
