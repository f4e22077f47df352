"""The time-outs of tests under load, and the order that they give to the tests."""

from pathlib import Path

import psutil
import pytest

from tests.conftest import longest_first
from tests.timeout import count_cores, scaled_timeout


@pytest.mark.parametrize(("load_per_core", "seconds"), [(0.2, 240.0), (3.0, 240.0), (9.0, 540.0)])
def test_a_timeout_scales_with_the_load_per_core_and_allows_for_a_machine_that_is_slower_than_its_load_says(
    monkeypatch: pytest.MonkeyPatch, load_per_core: float, seconds: float
) -> None:
    load = load_per_core * count_cores()
    monkeypatch.setattr(psutil, "getloadavg", lambda: (load, 0.0, 0.0))
    assert scaled_timeout(60.0) == pytest.approx(seconds)


def test_without_performance_counters_a_slow_machine_is_assumed(monkeypatch: pytest.MonkeyPatch) -> None:
    def getloadavg() -> None:
        raise RuntimeError("Performance counters may be disabled.")

    monkeypatch.setattr(psutil, "getloadavg", getloadavg)
    assert scaled_timeout(60.0) == 240.0


def test_the_timeout_of_a_test_is_scaled_whoever_sets_it(request: pytest.FixtureRequest) -> None:
    """What pytest-timeout reads: the closest marker."""
    item = request.node
    assert item.get_closest_marker("timeout").args[0] >= float(item.config.getini("timeout"))


@pytest.mark.timeout(1234)
def test_a_marker_of_the_test_comes_before_the_configuration(request: pytest.FixtureRequest) -> None:
    assert request.node.get_closest_marker("timeout").args[0] >= 1234


def test_every_process_begins_with_its_share_of_the_longest_tests(request: pytest.FixtureRequest) -> None:
    def item(name: str, timeout: float | None = None, fixture: str | None = None) -> pytest.Function:
        made = pytest.Function.from_parent(request.node.parent, name=name, callobj=lambda: None)
        if timeout is not None:
            made.add_marker(pytest.mark.timeout(timeout))
        if fixture is not None:
            made.fixturenames.append(fixture)
        return made

    tests = [item("a"), item("long", 900), item("b"), item("c"), item("longest", 1200), item("d"), item("e")]
    found = [test.name for test in longest_first(tests, 2)]
    assert found == ["longest", "a", "b", "long", "c", "d", "e"], "xdist gives three of seven to the first process"
    assert [test.name for test in longest_first(tests, 9)] == ["longest", "long", *"abcde"]
    pages = [item(f"page {number}", 600, "browser") for number in range(4)]
    for page, module in zip(pages, ("one.py", "one.py", "other.py", "last.py"), strict=True):
        page.path = Path(module)
    found = [test.name for test in longest_first([*tests, *pages], 4)]
    assert found == ["page 0", "page 1", "page 2", "page 3", "a", "longest", "b", "c", "long", "d", "e"]
