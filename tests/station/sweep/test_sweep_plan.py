"""The plan of a sweep: grids, samples and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from station.messages.study_messages import SweepCode
from station.sweep.sweep_plan import PlanError, read_plan
from tests.refusals import raises_refusal
from tests.station.command import assert_refused


def test_a_grid_has_every_combination_in_the_order_of_the_axes(tmp_path: Path) -> None:
    plan = read_plan(write_plan(tmp_path, 'rest_length_m = [0.7, 0.74]\ncondition = ["rigid", "both"]'))
    points = [(p["rest_length_m"], p["cuff"], p["condition"]) for p in plan.points()]
    assert points == [(r, c, k) for r in (0.7, 0.74) for c in ("hand", "elbow") for k in ("rigid", "both")]


def test_the_defaults_are_the_bundled_files(tmp_path: Path) -> None:
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
    samples = (np.array([float(str(p["rest_length_m"])) for p in plan.points()]) - 0.6) / 0.2
    assert sorted((samples * 20).astype(int)) == list(range(20))


@pytest.mark.parametrize(
    ("vary", "head", "code", "key"),
    [
        ("rest_length = 0.7", "", SweepCode.WRONG_TABLE, "vary.rest_length"),
        ("", "evry = 3\n", SweepCode.WRONG_TABLE, "evry"),
        ("", "every = 0\n", SweepCode.WRONG_TABLE, "every"),
        ("", 'method = "sobol"\n', SweepCode.WRONG_TABLE, "method"),
        ("", 'method = "random"\n', SweepCode.WRONG_TABLE, "count"),
        ("rest_length_m = -0.7", "", SweepCode.WRONG_VALUE, "vary.rest_length_m"),
        ('rest_length_m = "long"', "", SweepCode.WRONG_VALUE, "vary.rest_length_m"),
        ("stiffness_n_per_m = 0", "", SweepCode.WRONG_VALUE, "vary.stiffness_n_per_m"),
        ("hand_mass_kg = -1", "", SweepCode.WRONG_VALUE, "vary.hand_mass_kg"),
        ("arm_point_m = [0.0, 0.1, nan]", "", SweepCode.WRONG_VALUE, "vary.arm_point_m.2"),
        ("rest_length_m = []", "", SweepCode.EMPTY_AXIS, "vary.rest_length_m"),
        ("rest_length_m = { first = 0.6, last = 0.8 }", "", SweepCode.SPAN_OF_GRID, "vary.rest_length_m"),
        ("arm_point_m = [0.0, 0.1]", "", SweepCode.WRONG_VALUE, "vary.arm_point_m.2"),
        ('condition = "loose"', "", SweepCode.WRONG_VALUE, "vary.condition"),
        ("model = 3", "", SweepCode.WRONG_VALUE, "vary.model"),
        ("model = ", "", SweepCode.UNREADABLE, "plan.toml"),
    ],
)
def test_a_wrong_plan_is_refused_with_the_name_of_its_key(
    tmp_path: Path, vary: str, head: str, code: SweepCode, key: str
) -> None:
    with raises_refusal(code, kind=PlanError) as caught:
        read_plan(write_plan(tmp_path, vary, head))
    assert key in str(caught.value)


def test_a_plan_without_cuffs_and_one_that_is_missing_are_refused(tmp_path: Path) -> None:
    (tmp_path / "bare.toml").write_text("[vary]\n", encoding="utf-8")
    with raises_refusal(SweepCode.WRONG_TABLE, kind=PlanError) as caught:
        read_plan(tmp_path / "bare.toml")
    assert "vary.cuffs" in str(caught.value)
    (tmp_path / "empty.toml").write_text("", encoding="utf-8")
    with raises_refusal(SweepCode.WRONG_TABLE, kind=PlanError):
        read_plan(tmp_path / "empty.toml")
    with raises_refusal(SweepCode.UNREADABLE, kind=PlanError):
        read_plan(tmp_path / "none.toml")


def test_the_plans_in_the_docs_are_plans(tmp_path: Path) -> None:
    docs = (Path(__file__).parents[3] / "docs" / "sweep.md").read_text(encoding="utf-8")
    grid, sample = (block.split("```")[0] for block in docs.split("```toml\n")[1:])
    points = []
    for text in (grid, sample):
        (tmp_path / "plan.toml").write_text(text, encoding="utf-8")
        points.append(list(read_plan(tmp_path / "plan.toml").points()))
    assert [len(design) for design in points] == [2 * 2 * 2 * 3 * 2 * 2 * 2 * 2, 500]


def test_a_wrong_plan_ends_the_verb(station, tmp_path: Path) -> None:
    plan = write_plan(tmp_path, "rest_length_m = -1")
    assert_refused(station("sweep", plan, "--output", tmp_path / "out"), 1, SweepCode.WRONG_VALUE)
    assert not (tmp_path / "out").exists()


# Small plans for tests: a few frames of the bundled motion, published cuffs.


CUFFS = {
    "waist": (2140.0, 124.0, 0.012),
    "hand": (8520.0, 210.0, 0.012),
    "elbow": (2530.0, 139.0, 0.022),
}
KEYS = ("stiffness_n_per_m", "damping_n_s_per_m", "migration_m")
CUFF = 'cuff = ["hand", "elbow"]\n'


def write_plan(folder: Path, vary: str = "", head: str = "every = 60\n") -> Path:
    """plan.toml beside a cuffs.json; vary goes into its table of that name."""
    cuffs = {name: dict(zip(KEYS, values, strict=True)) for name, values in CUFFS.items()}
    (folder / "cuffs.json").write_text(json.dumps({"cuffs": cuffs}), encoding="utf-8")
    path = folder / "plan.toml"
    cuff = "" if "cuff = " in vary else CUFF
    path.write_text(f'{head}[vary]\ncuffs = "cuffs.json"\n{cuff}{vary}', encoding="utf-8")
    return path
