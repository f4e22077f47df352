"""Draw the pictures of README and docs from a session of the demo: `python -m docs.pictures.draw [simulated/demo]`.

report.png needs Chromium. The console's four pictures are of a session that a person led, and are not drawn here.
"""

from __future__ import annotations

import io
import shutil
import sys
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from PIL import Image

import cuffstation as cs
from solver.redundancy.glenoid import glenoid_cone
from station.report.canvas import FORCE, LINE, MOTION, SHADES, STYLE
from station.report.fit_figures import repeat_figure

HERE = Path(__file__).parent
CUFF, REPEAT = "hand", 2
BUSIEST = 6
MM = 1e3
COLOURS = 128
"""Of a screenshot's palette: enough for text and lines, at a third of the bytes."""


def draw_fit(session: Path) -> None:
    """fit.png: what the fit reads and what it returns, of one repeat."""
    fitted = cs.fit_session(session)
    fit = fitted.cuffs[CUFF]
    shown = {
        curves.trial.test: curves
        for curves in fitted.curves.values()
        if curves.trial.cuff.name == CUFF and curves.trial.repeat == REPEAT
    }
    (HERE / "fit.png").write_bytes(repeat_figure(fit, shown["static"], shown["dynamic"]))


@mpl.rc_context(STYLE)
def draw_redundancy() -> None:
    """redundancy.png: activations of the bundled arm raise, and the joint reaction with and without the cone."""
    model = cs.load_model()
    motion = cs.load_motion(model, every=5)
    bound, free = (
        cs.solve_motion(model, motion, cs.RedundancyOptions(has_glenoid_cone=has_cone)) for has_cone in (True, False)
    )
    figure = Figure(figsize=(10.4, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[1.9, 1])
    _draw_activations(left, bound)
    along, across = (MM * half for half in glenoid_cone(model).rim)
    right.add_patch(Ellipse((0, 0), 2 * along, 2 * across, fill=False, color=LINE, linewidth=1.2, label="rim"))
    right.plot(*(MM * free.contact.T), color=MOTION, linewidth=1.2, label="reaction, no constraint")
    right.plot(*(MM * bound.contact.T), color=FORCE, linewidth=1.6, label="reaction, constrained")
    reach = 1.7 * max(along, across)  # without the constraint the reaction leaves the glenoid by far
    right.set(xlim=(-reach, reach), ylim=(-reach, reach), aspect="equal")
    right.set(xlabel="towards the edge marker [mm]", ylabel="across [mm]", title="glenoid: where the reaction passes")
    right.legend(loc="lower left", fontsize="x-small")
    figure.savefig(HERE / "redundancy.png", dpi=110)


def _draw_activations(axis: Axes, solution: cs.MotionSolution) -> None:
    busiest = np.argsort(np.nanmax(solution.activations, axis=0))[::-1][:BUSIEST]
    for place, muscle in enumerate(busiest):
        axis.plot(
            solution.time,
            solution.activations[:, muscle],
            label=solution.muscles[muscle],
            color=SHADES[place % len(SHADES)],
            linestyle="-" if place < len(SHADES) else "--",
        )
    axis.set(xlabel="time [s]", ylabel="activation", title="arm raise: the busiest muscles")
    axis.legend(fontsize="x-small", loc="upper left")


def draw_report(session: Path) -> None:
    """report.png: the head of the report, the table of the cuffs, and two figures of the assessment."""
    from playwright.sync_api import sync_playwright

    browser_path = shutil.which("chromium") or shutil.which("chromium-browser")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=browser_path, args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 1100, "height": 1000})
        page.goto((session / "report.html").resolve().as_uri())
        end = page.locator("table").first.evaluate("table => table.getBoundingClientRect().bottom")
        head = page.screenshot(clip={"x": 0, "y": 0, "width": 1100, "height": end + 24})
        figures = [page.locator("figure").nth(place).screenshot() for place in range(2)]
        browser.close()
    top, *below = (Image.open(io.BytesIO(picture)).convert("RGB") for picture in (head, *figures))
    joined = Image.new("RGB", (top.width, top.height + max(picture.height for picture in below) + 16), "white")
    joined.paste(top, (0, 0))
    margin = (top.width - sum(picture.width for picture in below)) // 2
    for place, picture in enumerate(below):
        joined.paste(picture, (margin + place * picture.width, top.height))
    joined.quantize(COLOURS).save(HERE / "report.png", optimize=True)


if __name__ == "__main__":
    of = Path(sys.argv[1] if len(sys.argv) > 1 else "simulated/demo")
    draw_redundancy()
    draw_fit(of)
    draw_report(of)
