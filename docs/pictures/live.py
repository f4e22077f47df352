"""Draw the live page and Rerun's scene of a recorded motion: `python -m docs.pictures.live motion.mcap [station.toml]`.

live.png is the page beside a replay in real time, live-rerun.png Rerun's web viewer with the same values. station.toml
has the section [live]: cuffs and rest lengths that are solved. Needs Chromium.
"""

from __future__ import annotations

import io
import os
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image
from playwright.sync_api import Page, sync_playwright

from docs.pictures.draw import COLOURS, HERE
from station.report.page import browser_path

STATION = (sys.executable, "-c", "from station.cli import main; main()", "live")
SHOWN_AFTER_S = 14.0
"""Seconds of the replay: after the first cycle of the arm, so that there is a best rest length."""
RERUN_START_S = 25.0
SOFTWARE_GL = ("--no-sandbox", "--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


def draw_live_page(recording: Path, options: list[str]) -> None:
    """live.png."""
    port = _free_port()
    replay = subprocess.Popen([*STATION, str(recording), *options, "--page", "--port", str(port)])  # noqa: S603
    try:
        with sync_playwright() as playwright:
            browser = playwright.chromium.launch(executable_path=browser_path(), args=["--no-sandbox"])
            page = browser.new_page(viewport={"width": 1366, "height": 960})
            _open(page, port)
            page.get_by_text("best for this motion so far").wait_for(timeout=120_000)
            page.wait_for_timeout(1000 * SHOWN_AFTER_S)
            _save(page.screenshot(), "live.png")
            browser.close()
    finally:
        replay.send_signal(signal.SIGINT)  # as Ctrl-C: it ends the page, too
        replay.wait()


def draw_live_scene(recording: Path, options: list[str]) -> None:
    """live-rerun.png."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "live.rrd"
        subprocess.run([*STATION, str(recording), *options, "--rrd", str(file)], check=True)  # noqa: S603
        port, web = _free_port(), _free_port()
        command = ["-m", "rerun", str(file), "--serve-web", "--port", str(port), "--web-viewer-port", str(web)]
        viewer = subprocess.Popen([sys.executable, *command], start_new_session=True)  # noqa: S603
        try:
            with sync_playwright() as playwright:
                browser = playwright.chromium.launch(executable_path=browser_path(), args=list(SOFTWARE_GL))
                page = browser.new_page(viewport={"width": 1280, "height": 760})
                _open(page, web, f"?url=rerun%2Bhttp://127.0.0.1:{port}/proxy&renderer=webgl&theme=light")
                page.wait_for_timeout(1000 * RERUN_START_S)
                _save(page.screenshot(), "live-rerun.png")
                browser.close()
        finally:
            os.killpg(viewer.pid, signal.SIGTERM)  # the viewer is a child of the process that was started
            viewer.wait()


def _open(page: Page, port: int, query: str = "") -> None:
    """Once the server listens."""
    while True:
        with socket.socket() as tried:
            if tried.connect_ex(("127.0.0.1", port)) == 0:
                break
        page.wait_for_timeout(200)
    page.goto(f"http://127.0.0.1:{port}/{query}")


def _free_port() -> int:
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port: int = free.getsockname()[1]
        return port


def _save(drawn: bytes, name: str) -> None:
    Image.open(io.BytesIO(drawn)).convert("RGB").quantize(COLOURS).save(HERE / name, optimize=True)


if __name__ == "__main__":
    configured = ["--config", sys.argv[2]] if len(sys.argv) > 2 else []
    draw_live_page(Path(sys.argv[1]), configured)
    draw_live_scene(Path(sys.argv[1]), configured)
