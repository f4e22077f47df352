"""The suit file: the published masses, where they act, and one sentence for each way to get it wrong."""

from dataclasses import replace

import numpy as np
import pytest

from solver.bundled import bundled_model
from solver.suit.suit import BUNDLED_SUIT, SuitError, ensure_fits, read_suit, suit_toml, with_suit_masses

MODEL = bundled_model()
SUIT = read_suit()


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


def test_the_bundled_suit_fits_the_bundled_model_and_no_other_body():
    ensure_fits(SUIT, MODEL)
    with pytest.raises(SuitError, match="pelvis"):
        ensure_fits(replace(SUIT, waist=replace(SUIT.waist, body="pelvis")), MODEL)


@pytest.mark.parametrize(
    ("lost", "sentence"),
    [
        (
            {"waist": replace(SUIT.waist, body="pelvis")},
            "exotendon.waist is on the body pelvis, which .* it has ground",
        ),
        ({"masses": (replace(SUIT.masses[0], body="leg"),)}, "masses.waist is on the body leg"),
        ({"groups": {"calf": ("Soleus", "BIC_long")}}, "groups.calf names Soleus, which"),
    ],
)
def test_a_suit_for_another_body_is_refused_by_name(lost, sentence):
    with pytest.raises(SuitError, match=sentence):
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
    ("old", "new", "sentence"),
    [
        (
            "stiffness_n_per_m = 500.0",
            "stiffness_n_per_m = -1",
            "stiffness_n_per_m should be a number above 0 and is -1",
        ),
        ("stiffness_n_per_m = 500.0", "stiffness_n_per_m = 0", "stiffness_n_per_m should be a number above 0"),
        ("stiffness_n_per_m = 500.0", "stiffness_n_per_m = true", "stiffness_n_per_m should be a number above 0"),
        ("reference_rest_length_m = 0.74", "reference_rest_length_m = 0", "rest_length_m should be a number above 0"),
        ("damping_n_s_per_m = 0.0", "damping_n_s_per_m = -1", "damping_n_s_per_m should be a number that is not neg"),
        ("damping_n_s_per_m = 0.0\n", "", "exotendon should have .* and lacks damping_n_s_per_m"),
        ("mass_kg", "mass_g", "lacks mass_kg"),
        ("count = 31", "count = 31, last_m = 1", "unknown last_m"),
        ("first = 0.58", "first = 0.98", "rising from above 0"),
        ("count = 31", "count = 4", "should be 5 to 10000"),
        ("point_m = [-0.0329, ", "point_m = [", "exotendon.waist.point_m should be three numbers"),
        ("point_m = [-0.0329, ", "point_m = [nan, ", "exotendon.waist.point_m should be three numbers and is"),
        ("inertia_kg_m2 = [2.321e-3", "inertia_kg_m2 = [-1", "waist.inertia_kg_m2 should be three numbers from 0 on"),
        ("mass_kg = 0.2", "mass_kg = 'light'", "masses.waist.mass_kg should be a number"),
        ("[masses.arm]", "[masses.leg]", "masses should have waist, shoulder, arm and lacks arm"),
        ("[masses.waist]", "[[masses.waist]]", "masses.waist should be a table"),
        ("[exotendon]", "[exotendon", "cannot be read"),
        ('"cord"', '"sideways"', "migration_direction should be one of cord, bone and is 'sideways'"),
        ('"backward"', '"forward"', "rate should be one of backward, central"),
        ('["TRIlong"]', '"TRIlong"', "groups.triceps should be a list of muscles"),
    ],
)
def test_a_malformed_suit_gives_one_sentence(tmp_path, old, new, sentence):
    path = tmp_path / "suit.toml"
    text = BUNDLED_SUIT.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(SuitError, match=sentence):
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
