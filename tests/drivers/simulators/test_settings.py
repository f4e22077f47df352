from __future__ import annotations

from typing import Any

import pytest
from pydantic import ValidationError

from drivers.simulators.errors import SimulatorCode
from drivers.simulators.settings import Settings, settings_from_dict
from tests.drivers.simulators.refusals import raises_refusal


def test_by_default_the_cuffs_are_the_published_ones() -> None:
    truth = settings_from_dict({}).cuffs
    assert {name: (c.stiffness_n_per_m, c.damping_n_s_per_m, c.migration_m) for name, c in truth.items()} == {
        "waist": (2140, 124, 0.012),
        "hand": (8520, 210, 0.012),
        "tube": (5510, 38, 0.009),
        "elbow": (2530, 139, 0.022),
    }


def test_one_figure_of_a_cuff_can_be_changed_alone() -> None:
    cuffs = settings_from_dict({"cuffs": {"hand": {"stiffness_n_per_m": 6000}}}).cuffs
    assert (cuffs["hand"].stiffness_n_per_m, cuffs["hand"].damping_n_s_per_m) == (6000, 210)
    assert cuffs["tube"].stiffness_n_per_m == 5510


def test_what_was_set_is_what_a_dump_gives_back() -> None:
    settings = settings_from_dict({"rig": {"hook_n": 3}, "cuffs": {"new": settings_from_dict({}).cuffs["hand"]}})
    assert settings_from_dict(settings.model_dump()) == settings


@pytest.mark.parametrize(
    ("data", "naming"),
    [
        ({"speeed": 3}, "unknown key speeed"),
        ({"cuffs": {"hand": {"k": 3}}}, "unknown key cuffs.hand.k"),
        ({"cuffs": {"new": {"stiffness_n_per_m": 3}}}, "cuffs.new.damping_n_s_per_m"),
        ({"rig": {"hook_n": -2}}, "rig.hook_n is -2"),
        ({"operator": {"capture": "later"}}, "operator.capture is 'later'"),
        ({"slip": {"first_slip_n": 90}}, "slip.first_slip_n is 90 N"),
    ],
)
def test_what_makes_no_sense_is_refused_by_its_key(data: dict[str, Any], naming: str) -> None:
    with raises_refusal(SimulatorCode.WRONG_SETTING, naming):
        settings_from_dict(data)


def test_settings_cannot_be_changed_afterwards() -> None:
    with pytest.raises(ValidationError):
        Settings().seed = 3  # type: ignore[attr-defined]
