"""Updates a second of the console's page during a trial, in a browser without a window; meant for an idle computer.

    python -m benchmarks.page_rate [--updates N] [--pages N]

The simulated devices share the processors with the browser, unlike those of a bench.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from pathlib import Path

import numpy as np

from tests.station.console.browsing import CHROMIUM, begin, chromium, open_page, picture_updates, runs, until
from tests.station.console.served import ServedConsole, write_config


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("--updates", type=int, default=300)
    parser.add_argument("--pages", type=int, default=1)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        received = measure(Path(folder), options.updates, options.pages)
    load = os.getloadavg()[0]
    for times_s in received:
        gaps_ms = 1e3 * np.diff(times_s)
        median, late, longest = np.percentile(gaps_ms, [50, 99, 100])
        rate = len(gaps_ms) / (times_s[-1] - times_s[0])
        between = f"between two {median:.0f} ms (median), {late:.0f} (99 %), {longest:.0f} (longest)"
        print(f"{rate:.1f} updates a second; {between}")
    print(f"load average {load:.1f}")


def measure(folder: Path, updates: int, pages: int) -> list[list[float]]:
    """Arrival times of the updates [s], one list per page."""
    config = write_config(folder, hold_s=600.0)
    with chromium(CHROMIUM) as browser, ServedConsole(config, "--simulated") as console:
        opened = [open_page(browser, console.address) for _ in range(pages)]
        received = [picture_updates(page) for page in opened]
        begin(opened[0])
        opened[0].keyboard.press("a")
        for page in opened:
            runs(page)
        for times_s in received:
            times_s.clear()  # those of the armed trial
        until(opened[0], lambda: min(len(times_s) for times_s in received) > updates)
        times = [list(times_s) for times_s in received]
        opened[0].keyboard.press("s")
        opened[0].get_by_text("Keep (k)").first.wait_for()
    return times


if __name__ == "__main__":
    main()
