from math import inf
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.simulators.errors import SimulatorCode
from drivers.simulators.faults import Fault, Faults, fault_from_dict, read_fault_plan
from drivers.simulators.settings import Settings, settings_from_dict
from drivers.simulators.world import World
from tests.refusals import raises_refusal

PLAN = """
[[faults]]
device = "ni"
fault = "unplug"
at_s = 3
for_s = 2.5

[[faults]]
device = "qtm"
fault = "drop_labels"
capture = 0
labels = ["cuff_1"]
"""


def test_by_default_the_cuffs_are_the_published_ones_and_one_figure_can_be_changed_alone() -> None:
    truth = settings_from_dict({}).cuffs
    assert {name: (c.stiffness_n_per_m, c.damping_n_s_per_m, c.migration_m) for name, c in truth.items()} == {
        "waist": (2140, 124, 0.012),
        "hand": (8520, 210, 0.012),
        "tube": (5510, 38, 0.009),
        "elbow": (2530, 139, 0.022),
    }
    cuffs = settings_from_dict({"cuffs": {"hand": {"stiffness_n_per_m": 6000}}}).cuffs
    assert (cuffs["hand"].stiffness_n_per_m, cuffs["hand"].damping_n_s_per_m) == (6000, 210)
    assert cuffs["tube"].stiffness_n_per_m == 5510


def test_what_was_set_is_what_a_dump_gives_back_and_cannot_be_changed_afterwards() -> None:
    settings = settings_from_dict({"rig": {"hook_n": 3}, "cuffs": {"new": settings_from_dict({}).cuffs["hand"]}})
    assert settings_from_dict(settings.model_dump()) == settings
    with pytest.raises(ValidationError):
        Settings().seed = 3  # type: ignore[attr-defined]


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


# The plan of what goes wrong, and what becomes of the sync line; faults on the wires stand in tests/drivers.


def plan_file(folder: Path, text: str | bytes) -> Path:
    path = folder / "plan.toml"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def test_a_plan_is_read_with_what_it_leaves_out_or_refused_where_it_is_not_there(tmp_path: Path) -> None:
    assert read_fault_plan(plan_file(tmp_path, PLAN)) == (
        Fault("ni", "unplug", at_s=3.0, for_s=2.5),
        Fault("qtm", "drop_labels", at_s=0.0, for_s=inf, capture=0, labels=("cuff_1",)),
    )
    with raises_refusal(SimulatorCode.WRONG_FAULT_PLAN, "plan.toml cannot be read"):
        read_fault_plan(tmp_path / "none" / "plan.toml")


@pytest.mark.parametrize(
    ("text", "naming"),
    [
        ("[[faults]]\ndevice = 'daq'\nfault = 'fire'", "device is 'daq', expected 'ni', 'qtm', 'serial' or 'sync'"),
        ("[[faults]]\ndevice = 'ni'\nfault = 'fire'", "ni has no fault 'fire'; it has overrun"),
        ("[[faults]]\ndevice = 'ni'\nfault = 'freeze'\nuntil = 3", "freeze of ni: unknown key until"),
        ("[[faults]]\ndevice = 'ni'\nfault = 'freeze'\nat_s = -1", "at_s is -1, expected a number of at least 0"),
        ("[[faults]]\ndevice = 'ni'\nfault = 'freeze'\nfor_s = nan", "for_s is nan"),
        ("[[faults]]\ndevice = 'ni'\nfault = 'freeze'\ncapture = 1.5", "capture is 1.5, expected a whole number"),
        ("[[faults]]\ndevice = 'qtm'\nfault = 'drop_labels'\nlabels = 'cuff_1'", "labels is 'cuff_1', expected a list"),
        ("faults = [3]", "a fault is 3, expected a table"),
        ("faults = 3", "[[faults]]"),
        ("fault = []", "[[faults]]"),
        ("[[faults", "plan.toml cannot be used"),
        (b"\xff", "plan.toml cannot be used"),
    ],
)
def test_a_plan_that_cannot_be_used_is_refused_in_one_line(tmp_path: Path, text: str | bytes, naming: str) -> None:
    with raises_refusal(SimulatorCode.WRONG_FAULT_PLAN, naming):
        read_fault_plan(plan_file(tmp_path, text))


@pytest.mark.parametrize(("device", "naming"), [("nix", "'nix' is not a device"), ("qtm", "qtm has no fault 'freeze'")])
def test_a_fault_that_its_device_lacks_is_a_value_error(device: Any, naming: str) -> None:
    with pytest.raises(ValueError, match=naming):
        Fault(device, "freeze", 0.0, 1.0)


def test_faults_go_on_from_their_begin_to_their_end_and_belong_to_their_capture() -> None:
    now = [5.0]
    faults = Faults(lambda: now[0], [Fault("ni", "freeze", 1.0, 2.0, capture=2), Fault("ni", "refuse", 1.0, 2.0, 0)])
    faults.capture_started(1, 10.0)
    assert faults.of("ni", "freeze") == []
    faults.capture_started(2, 20.0)
    assert [at for at in (20.9, 21.0, 22.9, 23.0) if faults.active("ni", "freeze", at) is not None] == [21.0, 22.9]
    assert faults.active("ni", "refuse", 1.5)
    faults.inject(Fault("ni", "overrun", 0.0, 0.0))
    assert faults.has_begun("ni", "overrun", since=4.9)
    assert not faults.has_begun("ni", "overrun", since=5.0)


def sync_line(fault: str, **when: Any) -> tuple[np.ndarray[Any, Any], World]:
    """The line each millisecond from 0 to 4 s; the capture lasts from 1 s to 2 s."""
    plan = [fault_from_dict({"device": "sync", "fault": fault, **when})]
    world = World(settings_from_dict({}), speed=None, fault_plan=plan)
    world.clock.advance(1.0)
    world.start_capture()
    world.clock.advance(1.0)
    world.stop_capture()
    world.clock.advance(2.0)
    return world.sync_voltage(np.arange(0.0005, 4.0, 0.001)) > 2.5, world


def edges(is_high: np.ndarray[Any, Any]) -> list[int]:
    """Milliseconds at which the line changes."""
    return (np.flatnonzero(np.diff(is_high)) + 1).tolist()


@pytest.mark.parametrize(
    ("fault", "when", "expected"),
    [
        ("glitch", {"at_s": 0.5, "capture": 0}, [500, 503, 1000, 2000]),
        ("glitch", {"at_s": 0.5}, [1000, 1500, 1503, 2000]),
        ("double_edge", {"at_s": 0.02}, [1000, 1020, 1070, 2000]),
        ("no_stop_edge", {}, [1000]),
        ("no_stop_edge", {"for_s": 0.5}, [1000, 2500]),
        ("early_edge", {}, [1000, 2000]),  # it is the frames that come late
    ],
)
def test_the_sync_line_misbehaves_as_planned(fault: str, when: dict[str, Any], expected: list[int]) -> None:
    assert edges(sync_line(fault, **when)[0]) == expected


def test_a_line_of_wrong_polarity_is_low_during_the_capture() -> None:
    is_high, _ = sync_line("wrong_polarity", capture=0)
    assert is_high[0]
    assert edges(is_high) == [1000, 2000]
