"""The suit file, its masses and refusals, and a suit fitted to a person by markers on its cuffs."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model, simulate_arm_raise
from solver.errors import SolverCode
from solver.multibody.postures import points_in_ground, postures
from solver.scaling import Scaling, scale_model
from solver.suit.digitised_points import fitted_to, suit_from_markers
from solver.suit.suit import BUNDLED_SUIT, PARTS, SuitPoint, ensure_fits, read_suit, suit_toml, with_suit_masses
from tests.refusals import raises_refusal

MODEL = bundled_model()
SUIT = read_suit()
POSTURES = simulate_arm_raise(MODEL).coordinates[::100]


def test_the_bundled_suit_is_the_published_one_where_it_was_published():
    masses = {worn.body: worn for worn in SUIT.masses if worn.inertia.any()}
    np.testing.assert_allclose(masses["humerus"].inertia, [6.122e-4, 7.444e-4, 6.122e-4])
    np.testing.assert_allclose(masses["thorax"].inertia, [2.321e-3, 4.560e-3, 2.321e-3])
    assert sum(worn.mass for worn in SUIT.masses) == pytest.approx(0.6)
    # a hollow cylinder with a 2 mm wall: the figures are those of its radii and height
    for body, inner, height in (("thorax", 0.15, 0.05), ("humerus", 0.06, 0.12)):
        square = inner**2 + (inner + 0.002) ** 2
        along, across = 0.2 * square / 2, 0.2 * (3 * square + height**2) / 12
        np.testing.assert_allclose(masses[body].inertia, [across, along, across], rtol=1e-3)


def test_the_suits_masses_move_the_bodies_centres_and_resist_turning():
    bare, worn = MODEL, with_suit_masses(MODEL, SUIT)
    humerus, thorax = MODEL.body_index("humerus"), MODEL.body_index("thorax")
    assert worn.bodies[humerus].mass - bare.bodies[humerus].mass == pytest.approx(0.2)
    assert worn.bodies[thorax].mass - bare.bodies[thorax].mass == pytest.approx(0.4)
    # about the body's origin, inertias simply add up
    arm = SUIT.masses[2]
    added = _about_origin(worn.bodies[humerus]) - _about_origin(bare.bodies[humerus])
    offset = arm.center
    expected = np.diag(arm.inertia) + arm.mass * (offset @ offset * np.eye(3) - np.outer(offset, offset))
    np.testing.assert_allclose(added, expected, atol=1e-12)


def _about_origin(body):
    c = body.mass_center
    return body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))


@pytest.mark.parametrize(
    ("lost", "code", "naming"),
    [
        ({"waist": replace(SUIT.waist, body="pelvis")}, SolverCode.SUIT_BODY, "exotendon.waist is on the body pelvis"),
        ({"masses": (replace(SUIT.masses[0], body="leg"),)}, SolverCode.SUIT_BODY, "masses.waist is on the body leg"),
        ({"groups": {"calf": ("Soleus", "BIC_long")}}, SolverCode.SUIT_MUSCLE, "groups.calf names Soleus"),
    ],
)
def test_a_suit_for_another_body_is_refused_by_name(lost, code, naming):
    ensure_fits(SUIT, MODEL)
    with raises_refusal(code, naming):
        ensure_fits(replace(SUIT, **lost), MODEL)


def test_what_a_suit_file_leaves_out_is_as_published(tmp_path):
    text = BUNDLED_SUIT.read_text(encoding="utf-8")
    lines = [
        line for line in text[: text.index("[groups]")].splitlines() if not line.startswith(("migration_d", "rate"))
    ]
    path = tmp_path / "suit.toml"
    path.write_text("\n".join(lines), encoding="utf-8")
    suit = read_suit(path)
    assert (suit.migration_direction, suit.rate, suit.groups) == ("cord", "backward", {})


@pytest.mark.parametrize(
    ("old", "new", "naming"),
    [
        ("stiffness_n_per_m = 500.0", "stiffness_n_per_m = -1", "stiffness_n_per_m is -1, expected a number above 0"),
        ("stiffness_n_per_m = 500.0", "stiffness_n_per_m = 0", "stiffness_n_per_m is 0, expected a number above 0"),
        ("stiffness_n_per_m = 500.0", "stiffness_n_per_m = true", "stiffness_n_per_m is True, expected a number"),
        ("reference_rest_length_m = 0.74", "reference_rest_length_m = 0", "rest_length_m is 0, expected a number"),
        ("damping_n_s_per_m = 0.0", "damping_n_s_per_m = -1", "damping_n_s_per_m is -1, expected a number of at"),
        ("damping_n_s_per_m = 0.0\n", "", "exotendon.damping_n_s_per_m is missing"),
        ("mass_kg", "mass_g", "mass_kg is missing, and mass_g is not known"),
        ("mass_kg = 0.2", "mass_kg = 200.0", "waist.mass_kg is 200.0, expected a number of at most 100"),
        ("point_m = [-0.0329", "point_m = [-32.9", "waist.point_m.0 is -32.9, expected a number of at least -10"),
        ("inertia_kg_m2 = [2.321e-3", "inertia_kg_m2 = [2.321", "no moment above the sum of the other two"),
        ('["TRIlong"]', "[]", "groups.triceps is [], expected a list of 1 or more"),
        ("count = 31", "count = 31, last_m = 1", "unknown key rest_lengths_m.last_m"),
        ("first = 0.58", "first = 0.98", "from 0.98 to 0.88 m, expected lengths that rise"),
        ("count = 31", "count = 4", "count is 4, expected a number of at least 5"),
        ("point_m = [-0.0329, ", "point_m = [", "exotendon.waist.point_m.2 is missing"),
        ("point_m = [-0.0329, ", "point_m = [nan, ", "exotendon.waist.point_m.0 is nan, expected a finite number"),
        ("inertia_kg_m2 = [2.321e-3", "inertia_kg_m2 = [-1", "waist.inertia_kg_m2.0 is -1, expected a number of"),
        ("mass_kg = 0.2", "mass_kg = 'light'", "masses.waist.mass_kg is 'light', expected a number"),
        ("[masses.arm]", "[masses.leg]", "masses.leg"),
        ("[masses.waist]", "[[masses.waist]]", "masses.waist is"),
        ("[exotendon]", "[exotendon", "cannot be read"),
        ('"cord"', '"sideways"', "migration_direction is 'sideways', expected 'cord' or 'bone'"),
        ('"backward"', '"forward"', "rate is 'forward', expected 'backward' or 'central'"),
        ('["TRIlong"]', '"TRIlong"', "groups.triceps is 'TRIlong', expected a list"),
    ],
)
def test_a_malformed_suit_is_refused_by_key(tmp_path, old, new, naming):
    path = tmp_path / "suit.toml"
    text = BUNDLED_SUIT.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with raises_refusal(SolverCode.SUIT_FILE if naming == "cannot be read" else SolverCode.SUIT_KEY, naming):
        read_suit(path)


def test_a_written_suit_is_read_back_to_the_last_digit(tmp_path):
    changed = replace(
        SUIT,
        stiffness=np.nextafter(500, 501),
        arm=replace(SUIT.arm, body='a "b"', location=np.array([1 / 3, -2e-17, 0.1])),
        migration_direction="bone",
        rate="central",
        groups={"Rücken": ("a", "b"), "one": ("c",)},
    )
    path = tmp_path / "suit.toml"
    path.write_text(suit_toml(changed), encoding="utf-8")
    back = read_suit(path)
    assert suit_toml(back) == suit_toml(changed)
    assert (back.stiffness, back.arm.body, back.groups) == (changed.stiffness, 'a "b"', dict(changed.groups))
    np.testing.assert_array_equal(back.arm.location, changed.arm.location)
    np.testing.assert_array_equal(back.rest_lengths, SUIT.rest_lengths)
    assert [worn.inertia.tolist() for worn in back.masses] == [worn.inertia.tolist() for worn in SUIT.masses]


def seen(suit):
    """Where the suit's points are in ground: (frames, 3, 3)."""
    state = postures(MODEL, POSTURES, np.zeros_like(POSTURES))
    points = (getattr(suit, part) for part in PARTS)
    return np.stack([points_in_ground(state, MODEL.body_index(p.body), p.location) for p in points], axis=1)


def test_the_points_come_back_with_the_noise_of_their_markers_and_masses_move_along():
    shift = {"waist": [0.01, -0.02, 0.0], "shoulder": [0.0, 0.03, 0.0], "arm": [0.0, 0.01, -0.01]}
    worn = replace(SUIT, **{p: SuitPoint(getattr(SUIT, p).body, getattr(SUIT, p).location + shift[p]) for p in PARTS})
    observed = seen(worn) + 1e-3 * np.random.default_rng(1).standard_normal((len(POSTURES), 3, 3))
    observed[0, 1] = np.nan
    found = suit_from_markers(SUIT, MODEL, POSTURES, observed)
    for place, part in enumerate(PARTS):
        np.testing.assert_allclose(getattr(found.suit, part).location, getattr(worn, part).location, atol=2.5e-3)
        assert 0.5e-3 < found.spread[part] < 3e-3
        moved = found.suit.masses[place].center - SUIT.masses[place].center
        np.testing.assert_allclose(moved, shift[part], atol=2.5e-3)


def test_a_marker_that_is_never_seen_is_refused_by_its_part():
    observed = seen(SUIT)
    observed[:, 2] = np.nan
    with raises_refusal(SolverCode.POINT_NOT_SEEN, naming="arm"):
        suit_from_markers(SUIT, MODEL, POSTURES, observed)


def test_rest_lengths_grow_with_a_body_that_is_larger_in_all_its_parts():
    bigger = scale_model(MODEL, Scaling({body.name: np.full(3, 1.1) for body in MODEL.bodies[1:]}))
    parts = {p: SuitPoint(getattr(SUIT, p).body, 1.1 * getattr(SUIT, p).location) for p in PARTS}
    posture = POSTURES[0].copy()
    grown = posture.copy()
    moves = [c.motion == "translation" for c in MODEL.coordinates]
    grown[moves] *= 1.1
    suit = fitted_to(replace(SUIT, **parts), bigger, grown, (SUIT, MODEL, posture))
    assert suit.reference_rest_length == pytest.approx(1.1 * SUIT.reference_rest_length, rel=1e-6)
    np.testing.assert_allclose(suit.rest_lengths, 1.1 * SUIT.rest_lengths, rtol=1e-6)
