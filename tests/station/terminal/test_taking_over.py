"""Console and terminal run the same session in turn, and each resumes it where the other was killed."""

from __future__ import annotations

import asyncio
from pathlib import Path

import pytest

from station.bench.simulation import clock_port
from station.config import load_config
from station.journal import read_journal
from station.session.controller import SessionController
from tests.station.console.served import write_config
from tests.station.session.benched import simulated_bench
from tests.station.terminal.practice import PATIENCE_S, Headless
from tests.timeout import scaled_timeout

SPEED = 30.0


@pytest.mark.slow
def test_terminal_and_console_resume_each_other_s_session_during_a_trial_and_before_a_decision(tmp_path: Path) -> None:
    """The terminal is killed while it records; its recorder goes on, and the console keeps that trial and records the
    next. It is closed before it decides, and the terminal does."""
    with simulated_bench(tmp_path / "bench", speed=SPEED) as (bench, _):
        ports = bench.ready["ports"]
        path = write_config(tmp_path, swing_s=5.0, ni=ports["ni"], qtm=ports["qtm"])
        with path.open("a") as file:
            file.write(f"\n[simulation.ports]\nclock = {ports['clock']}\n")
        options = ("--config", "station.toml", "--session", "simulated/monday", "--speed", str(SPEED))
        bench.request({"trial": {"cuff": "hand", "test": "static"}})
        with Headless(tmp_path, *options, "--subject", "P01") as terminal:
            assert terminal.until("session_opened")["trials"] == 2
            terminal.until("waiting", what="start")
            terminal.send("arm")
            terminal.until("state_changed", state="recording")
            terminal.child.kill()
        asyncio.run(_go_on_at_the_console(path, tmp_path / "simulated" / "monday", bench))
        with Headless(tmp_path, *options) as terminal:
            assert terminal.until("session_opened")["done"] == 1
            verdict = terminal.until("verdict")
            assert {"damping_n_s_per_m"} <= {figure["quantity"] for figure in verdict["figures"]}
            terminal.until("decided")
            terminal.until("summing_up")
            terminal.send("end")
            assert terminal.until("session_closed")["done"] == 2
            assert terminal.child.wait(scaled_timeout(PATIENCE_S)) == 0
    journal = read_journal(tmp_path / "simulated" / "monday")
    assert [(one.test, one.accepted) for one in journal.recorded] == [("static", True), ("dynamic", True)]
    assert [verdict.choice for verdict in journal.verdicts.values()] == ["accept", "accept"]


async def _go_on_at_the_console(path: Path, folder: Path, bench: object) -> None:
    config = load_config(path)
    controller = SessionController(config, SPEED, None, clock_port(config))
    try:
        controller.session.resume(folder)
        async with asyncio.timeout(scaled_timeout(PATIENCE_S)):
            while controller.session.judgement is None:  # as the page's heartbeat: the recorder's trial is waited for
                await controller.reviewer.process_recordings()
                await asyncio.sleep(0.2)
            controller.reviewer.decide("accept", "")
            bench.request({"trial": {"cuff": "hand", "test": "dynamic"}})  # type: ignore[attr-defined]
            await controller.runner.arm()
            while controller.runner.live is not None:
                await asyncio.sleep(0.05)
    finally:
        controller.close()
    assert controller.session.plan is not None and controller.session.plan.undecided is not None, (
        controller.session.message
    )
