"""The report's part on the cuffs: a picture of every repeat, what checks the law, and what other programs need."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure

from fitting.result import SessionFit
from fitting.session import fit_session
from fitting.spatial.tensor import Tensor, Tensors
from fitting.trial import build_trial
from station.report.canvas import fit_columns
from station.report.figures import dynamic_figure, static_figure, trial_figure
from station.report.fit_figures import complex_stiffness_figure, repeat_figure, repeats_figure, residual_figure
from station.report.muscle_figures import activation_figure
from station.report.page import write_report
from tests.fitting.experiment import Session, published

MOST_BYTES_PER_TRIAL = 400_000
"""24 trials keep below 10 MB."""


@cache
def _fitted() -> SessionFit:
    session = Session(published("waist", hold=4.0, duration=12.0), 1)
    trials = []
    for repeat in (1, 2):
        trials.append(build_trial(*session.static(repeat), f"static-{repeat}", f"s{repeat}"))
        trials.append(build_trial(*session.dynamic(repeat), f"dynamic-{repeat}", f"d{repeat}"))
    return fit_session(trials)


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[Figure]]:
    """The figures themselves, before they become PNG."""
    figures: list[Figure] = []

    def keep(figure: Figure) -> bytes:
        fit_columns(figure)
        figures.append(figure)
        return b""

    for module in ("figures", "fit_figures", "muscle_figures"):
        monkeypatch.setattr(f"station.report.{module}.as_png", keep)
    yield figures


@pytest.fixture(scope="module")
def told() -> list[tuple[str, int, int]]:
    """Progress of the page that was written."""
    return []


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory, told: list[tuple[str, int, int]]) -> Path:
    return write_report(tmp_path_factory.mktemp("report"), _fitted(), lambda *step: told.append(step))


def test_a_page_holds_every_repeat_and_the_checks_of_the_law_and_stays_small(written: Path) -> None:
    page = written.read_text(encoding="utf-8")
    captions = re.findall(r"<figcaption>(.*?)</figcaption>", page)
    for beginning in ("Repeat 1.", "Repeat 2.", "Each repeat on its own", "Complex stiffness", "What the law leaves"):
        assert sum(caption.startswith(beginning) for caption in captions) == 1
    assert written.stat().st_size < 4 * MOST_BYTES_PER_TRIAL
    assert not re.search(r"(src|href)=\"(?!data:|#)", page)


def test_progress_counts_as_many_figures_as_the_page_holds(written: Path, told: list[tuple[str, int, int]]) -> None:
    count = written.read_text(encoding="utf-8").count("<figure")
    assert told == [("drawing figures", done, count) for done in range(count + 1)]


@pytest.mark.usefixtures("drawn")
def test_recordings_that_were_fitted_are_not_read_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "cuff-waist_test-static_run-1.mcap").write_bytes(b"not a recording")
    monkeypatch.setattr("station.report.page.fit_session_folder", lambda *_: pytest.fail("read again"))
    assert write_report(tmp_path, _fitted()).is_file()


def test_the_same_session_gives_the_same_page(written: Path, tmp_path: Path) -> None:
    again = write_report(tmp_path / written.parent.name, _fitted())
    assert again.read_bytes() == written.read_bytes()


def test_a_page_holds_the_bushing_for_opensim(written: Path) -> None:
    assert "&lt;BushingForce name=&#34;waist_cuff&#34;&gt;" in written.read_text(encoding="utf-8")


@pytest.mark.usefixtures("drawn")
def test_a_page_tells_the_principal_values_of_a_cuff_pulled_in_space(tmp_path: Path) -> None:
    fitted = _fitted()
    tensor = Tensor(np.diag([1000.0, 2000.0, 3000.0]), 25.0 * np.eye(6), 1.96, 5)
    cuff = replace(fitted.cuffs["waist"], tensors=Tensors(tensor, None, "", "no"))
    page = write_report(tmp_path, replace(fitted, donnings={"waist": {"1": cuff}})).read_text(encoding="utf-8")
    assert "Stiffness in three dimensions" in page
    assert "Damping in three dimensions" not in page
    assert "2000.0 (1990.2\u00a0to\u00a02009.8)" in page


def test_the_drawn_line_goes_through_the_held_loads_within_their_errors(drawn: list[Figure]) -> None:
    fitted = _fitted()
    repeat_figure(fitted.cuffs["waist"], fitted.curves["static-1"], None)
    left = next(axis for axis in drawn[0].axes if axis.get_ylabel() == "off [mm]")
    dots = np.asarray(left.lines[1].get_ydata(), dtype=np.float64)
    assert len(dots)
    assert np.abs(dots).max() < 0.1


def test_the_tangent_stiffness_is_drawn_as_cuffs_json_has_it(drawn: list[Figure]) -> None:
    fitted = _fitted()
    fit = fitted.cuffs["waist"]
    static_figure(fit, [fitted.curves["static-1"], fitted.curves["static-2"]])
    _, beside = drawn[0].axes
    tangents = fit.held["exponential_law"]["tangents"]
    values = [each["stiffness_n_per_m"]["value"] for each in tangents]
    np.testing.assert_array_equal(np.asarray(beside.lines[0].get_ydata()), values)
    static_figure(replace(fit, held={}), [fitted.curves["static-1"]])
    assert len(drawn[1].axes) == 1


def test_a_repeat_without_one_of_its_trials_says_so(drawn: list[Figure]) -> None:
    fitted = _fitted()
    repeat_figure(fitted.cuffs["waist"], None, fitted.curves["dynamic-1"])
    repeat_figure(fitted.cuffs["waist"], fitted.curves["static-1"], None)
    said = [{text.get_text() for axis in figure.axes for text in axis.texts} for figure in drawn]
    assert "no static trial" in said[0]
    assert "no dynamic trial" in said[1]


def test_what_is_left_over_is_uncorrelated_and_normal_for_a_cuff_that_follows_the_law(drawn: list[Figure]) -> None:
    fitted = _fitted()
    residual_figure([fitted.curves["dynamic-1"], fitted.curves["dynamic-2"]])
    _, later, normal = drawn[0].axes
    assert np.abs(np.asarray(later.lines[0].get_ydata())).max() < 0.25
    expected, found = (np.asarray(values) for values in normal.lines[0].get_data())
    middle = np.abs(expected) < 2
    np.testing.assert_allclose(found[middle], expected[middle], atol=0.25)


def test_bands_and_repeats_are_drawn_beside_what_the_fit_says(drawn: list[Figure]) -> None:
    fit = _fitted().cuffs["waist"]
    complex_stiffness_figure(fit)
    repeats_figure(fit)
    assert fit.damping
    of_bands, of_repeats = (figure.axes[1] for figure in drawn)
    for axis in (of_bands, of_repeats):
        levels = [line.get_ydata() for line in axis.lines if len(np.unique(line.get_ydata())) == 1]
        assert any(np.allclose(level, fit.damping.value) for level in levels)
    assert len(of_repeats.lines[0].get_xdata()) == 2


def test_no_axis_s_name_lies_on_its_numbers(drawn: list[Figure]) -> None:
    fitted = _fitted()
    fit, static, dynamic = fitted.cuffs["waist"], fitted.curves["static-2"], fitted.curves["dynamic-1"]
    repeat_figure(fit, static, dynamic)
    repeats_figure(fit)
    residual_figure([dynamic])
    complex_stiffness_figure(fit)
    for axis in (axis for figure in drawn for axis in figure.axes):
        axis.figure.draw_without_rendering()
        numbers = [label.get_window_extent() for label in axis.get_yticklabels() if label.get_text()]
        name = axis.yaxis.label.get_window_extent()
        assert not any(name.overlaps(number) for number in numbers), axis.get_ylabel()


def test_no_axis_leaves_its_figure_or_lies_on_another(drawn: list[Figure]) -> None:
    fitted = _fitted()
    fit, static, dynamic = fitted.cuffs["waist"], fitted.curves["static-2"], fitted.curves["dynamic-1"]
    trial_figure(static, dynamic)
    repeat_figure(fit, static, dynamic)
    repeats_figure(fit)
    residual_figure([dynamic])
    complex_stiffness_figure(fit)
    static_figure(fit, [static])
    dynamic_figure(fit, [dynamic])
    for figure in drawn:
        figure.draw_without_rendering()
        for axis in figure.axes:
            around, side = axis.get_tightbbox(), axis.yaxis.get_tightbbox()
            assert figure.bbox.x0 <= around.x0 and around.x1 <= figure.bbox.x1, axis.get_ylabel()
            assert figure.bbox.y0 <= around.y0 and around.y1 <= figure.bbox.y1, axis.get_ylabel()
            assert not any(side.overlaps(other.bbox) for other in figure.axes if other is not axis), axis.get_ylabel()


def test_no_legend_hides_an_interval(drawn: list[Figure]) -> None:
    repeats_figure(_fitted().cuffs["waist"])
    drawn[0].draw_without_rendering()
    for axis in drawn[0].axes:
        assert not axis.get_legend().get_window_extent().overlaps(axis.get_window_extent())


def test_a_muscle_at_rest_is_a_line_at_zero(drawn: list[Figure]) -> None:
    at_rest = pd.DataFrame(
        {"time_s": [0.0, 1.0], "condition": "slack", "cuff": "", "DeltoideusScapula_P": 0.0, "TrapeziusScapula_S": 0.5}
    )
    activation_figure(at_rest, "hand")
    assert [axis.get_ylim() for axis in drawn[0].axes[:2]] == [(0.0, 0.01), (0.0, pytest.approx(0.525))]


def test_a_page_is_read_on_a_dark_screen_and_on_paper(written: Path) -> None:
    page = written.read_text(encoding="utf-8")
    assert "@media (prefers-color-scheme: dark)" in page
    assert "@media print" in page and "break-inside: avoid" in page


def test_what_is_missing_stands_first(tmp_path: Path) -> None:
    (tmp_path / "missing.json").write_text('["hand, static, repeat 2: no edge came"]', encoding="utf-8")
    page = write_report(tmp_path, _fitted()).read_text(encoding="utf-8")
    assert page.index("hand, static, repeat 2: no edge came") < page.index("<h2>")
