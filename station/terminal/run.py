"""`station record` without a test: a whole session on the terminal, or as lines of JSON."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from station.bench.session_folder import SIMULATED_FOLDER, is_for_simulated
from station.bench.simulation import SimulatedBench, clock_port, serves_simulated, simulator_settings
from station.config import StationConfig
from station.end_signals import end_signals
from station.errors import StationError
from station.exit_code import DONE, LOSSY
from station.journal import Setup, read_journal
from station.session.desk import Desk
from station.terminal.commands import Action, Command
from station.terminal.conductor import Conductor, Face, Request
from station.terminal.json_face import JsonFace
from station.terminal.keyboard import is_interactive, listen_to_lines, listening_to_keys
from station.terminal.text_face import SessionConsole, TextFace


class SetupMissing(StationError):
    """A new session and nobody says who is measured; one sentence."""

    exit_code = 2


def planned(
    config: StationConfig, folder: Path, subject: str | None, operator: str, cuffs: tuple[str, ...], repeats: int | None
) -> Setup | None:
    """The plan of a new session; None where the folder holds one and nothing else is asked for.

    Raises SetupMissing, JournalError.
    """
    there = read_journal(folder).setup
    if there is not None and (subject, operator, cuffs, repeats) == (None, "", (), None):
        return None
    if there is None and subject is None:
        raise SetupMissing(f"{folder} is a new session; give --subject, a code of letters and digits, like P01")
    known = there or Setup("", "", tuple(config.cuffs), config.protocol.repeats, config.bounce is not None)
    return Setup(
        subject or known.subject,
        operator or known.operator,
        cuffs or known.cuffs,
        repeats or known.repeats,
        known.has_bounce,
        known.number if there is not None else _number(folder),
        known.step_masses_kg,
    )


def run_session(
    config: StationConfig,
    folder: Path,
    setup: Setup | None,
    *,
    is_headless: bool = False,
    is_simulated: bool = False,
    speed: float | None = None,
    seed: int = 1,
) -> int:
    """Leads through the session and returns the exit code.

    setup None resumes the one that is there. speed is the pace of the simulated world; without is_simulated, that of
    `station simulate`, at the configuration's addresses. Raises CommandRefused, JournalError, SimulationError.
    """
    with ExitStack() as stack:
        bench = None
        if is_simulated:
            bench = stack.enter_context(SimulatedBench(simulator_settings(config), speed or 1.0, seed))
            config = bench.pointed_at(config)
        is_followed = not is_simulated and (speed is not None or serves_simulated(config))
        followed = clock_port(config) if is_followed else None
        desk = Desk(config, speed or 1.0, bench, followed)
        stack.callback(desk.close)
        if setup is None:
            desk.session.resume(folder)
        else:
            desk.session.begin(setup, folder=folder)
        return asyncio.run(_lead(desk, is_headless=is_headless, is_simulated=is_simulated))


def practice_folder(folder: Path) -> Path:
    """Where a session of simulated data goes: below a folder of that name."""
    return folder if is_for_simulated(folder) else folder.parent / SIMULATED_FOLDER / folder.name


async def _lead(desk: Desk, *, is_headless: bool, is_simulated: bool) -> int:
    loop, requests = asyncio.get_running_loop(), asyncio.Queue[Request]()

    def post(request: Request) -> None:
        with suppress(RuntimeError):  # the session has just ended
            loop.call_soon_threadsafe(requests.put_nowait, request)

    _end_on_signals(lambda: post(Command(Action.END)))
    with ExitStack() as stack:
        face = _face(stack, post, is_headless=is_headless)
        warming = asyncio.create_task(desk.reviewer.warm_up())
        waits_for_start = desk.session.config.mocap.control == "start"
        conductor = Conductor(desk, face, requests, is_simulated=is_simulated, waits_for_start=waits_for_start)
        await conductor.run()
        warming.cancel()
    return DONE if conductor.has_summary or not conductor.is_complete else LOSSY


def _face(stack: ExitStack, post: Callable[[Request], None], *, is_headless: bool) -> Face:
    if is_headless:
        listen_to_lines(post)
        return JsonFace(sys.stdout)
    if not is_interactive():
        listen_to_lines(post)
        return TextFace(SessionConsole(stderr=True), sys.stdout, is_interactive=False)
    face = stack.enter_context(TextFace(SessionConsole(stderr=True), sys.stdout, is_interactive=True))
    stack.enter_context(listening_to_keys(post, face.show_typed))
    return face


def _end_on_signals(end: Callable[[], None]) -> None:
    """Once: the running trial ends cleanly, and then the session. Twice: at once."""

    def handle(_signal: int, _frame: Any) -> None:
        end()

    for number in end_signals():
        signal.signal(number, handle)


def _number(folder: Path) -> str:
    """The session's label in file names: its folder's name, as far as that is letters and digits."""
    return "".join(letter for letter in folder.name if letter.isascii() and letter.isalnum())[:32] or "1"
