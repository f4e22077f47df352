"""`station record` without a test: a whole session on the terminal, or as lines of JSON."""

from __future__ import annotations

import asyncio
import signal
import sys
from collections.abc import Callable
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from recordings.samples import DeviceIdentity
from station.bench.session_folder import SIMULATED_FOLDER, check_folder, is_for_simulated
from station.bench.simulation import SimulatedBench, clock_port, is_served_by_simulator, simulator_settings
from station.bench.trial_recorder import TrialRefused
from station.config import StationConfig
from station.end_signals import end_signals
from station.errors import StationError
from station.exit_code import DONE, FAILED, LOSSY
from station.journal import Setup, read_journal
from station.messages.codes import CommandCode
from station.messages.message import Message
from station.session.controller import SessionController
from station.terminal.commands import (
    Action,
    Command,
    Request,
    SessionOutput,
    is_interactive,
    listen_to_lines,
    listening_to_keys,
)
from station.terminal.outputs import JsonOutput, SessionConsole, TextOutput
from station.terminal.sequencer import SessionSequencer

SIMULATOR = (DeviceIdentity("station simulate", "", is_simulated=True),)


class SetupMissing(StationError):
    """A new session without a subject."""

    exit_code = 2


def plan_session(
    config: StationConfig, folder: Path, subject: str | None, operator: str, cuffs: tuple[str, ...], repeats: int | None
) -> Setup | None:
    """The plan of a new session; None if the folder holds one and no option differs.

    Raises SetupMissing, JournalError.
    """
    existing = read_journal(folder).setup
    if existing is not None and (subject, operator, cuffs, repeats) == (None, "", (), None):
        return None
    if existing is None and subject is None:
        raise SetupMissing(Message(CommandCode.NEW_SESSION, {"folder": str(folder)}))
    conditions = config.body.conditions if config.body is not None else ()
    known = existing or Setup(
        "", "", tuple(config.cuffs), config.protocol.repeats, config.bounce is not None, conditions=conditions
    )
    return Setup(
        subject or known.subject,
        operator or known.operator,
        cuffs or known.cuffs,
        repeats or known.repeats,
        known.has_bounce,
        known.number if existing is not None else _number(folder),
        known.step_masses_kg,
        known.conditions,
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
    """Run the session and return the exit code.

    setup None resumes the session of the folder. speed is the pace of the simulated world; without is_simulated, that
    of `station simulate`, at the configuration's addresses. Raises CommandRefused, JournalError, SimulationError, and
    TrialRefused before the session begins.
    """
    with ExitStack() as stack:
        bench = None
        if is_simulated:
            bench = stack.enter_context(SimulatedBench(simulator_settings(config), speed or 1.0, seed, outlives=True))
            config = bench.configure(config)
        is_simulator = not is_simulated and (speed is not None or is_served_by_simulator(config))
        if is_simulator and (refusal := check_folder(folder, SIMULATOR)):
            raise TrialRefused(refusal)
        port = clock_port(config) if is_simulator else None
        controller = SessionController(config, speed or 1.0, bench, port)
        stack.callback(controller.close)
        if setup is None:
            controller.session.resume(folder)
        else:
            controller.session.begin(setup, folder=folder)
        return asyncio.run(_run(controller, is_headless=is_headless, is_simulated=is_simulated))


def practice_folder(folder: Path) -> Path:
    """The folder of a session of simulated data: below a folder of that name."""
    return folder if is_for_simulated(folder) else folder.parent / SIMULATED_FOLDER / folder.name


async def _run(controller: SessionController, *, is_headless: bool, is_simulated: bool) -> int:
    loop, requests = asyncio.get_running_loop(), asyncio.Queue[Request]()

    def post(request: Request) -> None:
        with suppress(RuntimeError):  # the session has just ended
            loop.call_soon_threadsafe(requests.put_nowait, request)

    _end_on_signals(lambda: post(Command(Action.END)))
    with ExitStack() as stack:
        output = _output(stack, post, is_headless=is_headless)
        warming = asyncio.create_task(controller.reviewer.warm_up())
        waits_for_start = controller.session.config.mocap.control == "start"
        sequencer = SessionSequencer(
            controller, output, requests, is_simulated=is_simulated, waits_for_start=waits_for_start
        )
        await sequencer.run()
        warming.cancel()
    if sequencer.is_refused:
        return FAILED
    return DONE if sequencer.has_summary or not sequencer.is_complete else LOSSY


def _output(stack: ExitStack, post: Callable[[Request], None], *, is_headless: bool) -> SessionOutput:
    if is_headless:
        listen_to_lines(post)
        return JsonOutput(sys.stdout)
    if not is_interactive():
        listen_to_lines(post)
        return TextOutput(SessionConsole(stderr=True), sys.stdout, is_interactive=False)
    output = stack.enter_context(TextOutput(SessionConsole(stderr=True), sys.stdout, is_interactive=True))
    stack.enter_context(listening_to_keys(post, output.show_typed))
    return output


def _end_on_signals(end: Callable[[], None]) -> None:
    """Once: the running trial ends cleanly, and then the session. Twice: at once."""

    def handle(_signal: int, _frame: Any) -> None:
        end()

    for number in end_signals():
        signal.signal(number, handle)


def _number(folder: Path) -> str:
    """The label of the session in file names: the letters and digits of its folder's name."""
    return "".join(letter for letter in folder.name if letter.isascii() and letter.isalnum())[:32] or "1"
