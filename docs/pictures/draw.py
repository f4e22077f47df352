"""Draw the pictures of README and docs from a session of the demo: `python -m docs.pictures.draw [simulated/demo]`.

fit.png, emg.png and report.png need Chromium. The console's pictures are screenshots of a test:

    pytest -m slow -n 0 -k "set_up_to_report or guided" --pictures docs/pictures tests/station/console
"""

from __future__ import annotations

import io
import sys
import tempfile
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from PIL import Image
from scipy import signal

import cuffstation as cs
from solver.redundancy.mechanics import glenoid_cone
from solver.time_series_table import write_table
from station.charts import svg
from station.charts.marks import Chart
from station.emg.comparison import ConditionFiles, compare_emg
from station.emg.emg_json import write_emg
from station.report.fit_figures import fit_figure
from station.report.page import browser_path
from station.report.plot import FORCE, LINE, MOTION, SHADES, STYLE
from station.report.wearer_section import shapes_figure

HERE = Path(__file__).parent
CUFF = "hand"
MUSCLES_SHOWN = 6
EMG_CHANNELS = 4
MM = 1e3
COLOURS = 256
"""Of a screenshot's palette: enough for text and lines, at less than half of the bytes."""


def draw_fit(session: Path) -> None:
    """fit.png: what the fit reads and what it returns, of one cuff, as the report shows it."""
    fit = cs.fit_session(session).cuffs[CUFF]
    static, dynamic = (
        [fitted for fitted in fit.pulls.values() if fitted.pull.trial.test == test] for test in ("static", "dynamic")
    )
    _screenshot(fit_figure(fit, static, dynamic), HERE / "fit.png")


@mpl.rc_context(STYLE)
def draw_redundancy() -> None:
    """redundancy.png: activations of the bundled arm raise, and the joint reaction with and without the cone."""
    model = cs.load_model()
    motion = cs.load_motion(model, every=5)
    bound, free = (
        cs.solve_motion(model, motion, cs.RedundancyOptions(has_glenoid_cone=has_cone)) for has_cone in (True, False)
    )
    figure = Figure(figsize=(10.4, 3.4), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=[1.5, 1.1, 1])
    _draw_activations(left, bound)
    cone = glenoid_cone(model)
    for solution, colour, name in ((free, MOTION, "without constraint"), (bound, FORCE, "with constraint")):
        angle = np.degrees(np.arctan2(np.linalg.norm(solution.contact, axis=1), cone.distance))
        middle.plot(solution.time, angle, color=colour, linewidth=1.5, label=name)
        right.plot(*(MM * solution.contact.T), color=colour, linewidth=1.5)
    limit = np.degrees(cone.half_angle)
    middle.axhline(limit, color=LINE, linestyle="--", linewidth=1.0, label=f"cone, {limit:.0f}°")
    middle.set(xlabel="time [s]", ylabel="angle between them [°]", ylim=(0, None), title="joint reaction and cone axis")
    middle.legend(fontsize="x-small", loc="upper center")
    along, across = (MM * half for half in cone.rim)
    right.add_patch(Ellipse((0, 0), 2 * along, 2 * across, fill=False, color=LINE, linestyle="--", linewidth=1.0))
    extent = 1.1 * MM * float(np.nanmax(np.abs(free.contact)))
    right.set(xlim=(-extent, extent), ylim=(-extent, extent), aspect="equal")
    right.set(xlabel="along the edge [mm]", ylabel="across [mm]", title="in the plane of the glenoid")
    figure.savefig(HERE / "redundancy.png", dpi=110)


def _draw_activations(axis: Axes, solution: cs.MotionSolution) -> None:
    largest = np.argsort(np.nanmax(solution.activations, axis=0))[::-1][:MUSCLES_SHOWN]
    for place, muscle in enumerate(largest):
        axis.plot(
            solution.time,
            solution.activations[:, muscle],
            label=solution.muscles[muscle],
            color=SHADES[place % len(SHADES)],
            linestyle="-" if place < len(SHADES) else "--",
        )
    axis.set(xlabel="time [s]", ylabel="activation", title=f"arm raise: the {MUSCLES_SHOWN} largest activations")
    axis.legend(fontsize="x-small", loc="upper left", ncols=2)
    axis.set_ylim(0, 1.35 * axis.get_ylim()[1])


def draw_emg() -> None:
    """emg.png: EMG simulated from activations of the bundled arm raise, beside them; the last is noise alone."""
    model = cs.load_model()
    solution = cs.solve_motion(model, cs.load_motion(model, every=5))
    muscles = np.argsort(np.nanmax(solution.activations, axis=0))[::-1][:EMG_CHANNELS]
    names = [solution.muscles[muscle] for muscle in muscles]
    time = np.arange(solution.time[0], solution.time[-1], 1e-3)
    delayed = (np.interp(time - 0.04, solution.time, solution.activations[:, muscle]) for muscle in muscles)
    levels = np.column_stack(list(delayed))
    levels[:, -1] = 0.1
    band = signal.butter(2, (40.0, 200.0), "bandpass", fs=1000.0, output="sos")
    raw = (0.01 + levels) * signal.sosfilt(band, np.random.default_rng(1).standard_normal(levels.shape), axis=0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_table(folder / "raise.csv", names, time, raw)
        write_table(folder / "activations.csv", solution.muscles, solution.time, solution.activations)
        channels = "".join(f'{muscle} = {{ muscles = ["{muscle}"] }}\n' for muscle in names)
        (folder / "setup.toml").write_text(f"[channels]\n{channels}", encoding="utf-8")
        condition = ConditionFiles((folder / "raise.csv",), (folder / "activations.csv",))
        compared = compare_emg(condition, ConditionFiles(()), (), folder / "setup.toml")
        document = write_emg(folder, compared, {})
    _screenshot(shapes_figure(document.trials[0]), HERE / "emg.png")


def _screenshot(chart: Chart, path: Path) -> None:
    """The chart as the report shows it on a light page."""
    from playwright.sync_api import sync_playwright

    page_style = "body { --ink: #1b1b1b; --quiet: #666; --paper: #fff; background: #fff; font-family: sans-serif; }"
    style = Path(svg.__file__).with_name("chart.css")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1080, "height": 50})
        page.set_content(f"<style>{style.read_text()}{page_style}</style>{svg.draw(chart, path.stem)}")
        drawn = page.screenshot(full_page=True)
        browser.close()
    Image.open(io.BytesIO(drawn)).convert("RGB").quantize(COLOURS).save(path, optimize=True)


def draw_report(session: Path) -> None:
    """report.png: the first page of the report, above its folded details."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1100, "height": 1000})
        page.goto((session / "report.html").resolve().as_uri())
        end = page.locator("details.section").first.evaluate("details => details.getBoundingClientRect().top")
        drawn = page.screenshot(clip={"x": 0, "y": 0, "width": 1100, "height": end}, full_page=True)
        browser.close()
    Image.open(io.BytesIO(drawn)).convert("RGB").quantize(COLOURS).save(HERE / "report.png", optimize=True)


if __name__ == "__main__":
    of = Path(sys.argv[1] if len(sys.argv) > 1 else "simulated/demo")
    draw_redundancy()
    draw_emg()
    draw_fit(of)
    draw_report(of)
