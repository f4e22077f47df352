"""Commands of the operator, in the order of their arrival, and the answers to them."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Protocol

from station.messages.codes import CommandCode
from station.messages.message import Message
from station.session.live_trial import LiveTrial
from station.session.open_session import CommandRefused
from station.terminal.commands import MEANINGS, Action, Command, UnknownCommand
from station.terminal.events import CommandAnswered, Event, PlanListed

Request = Command | UnknownCommand


class SessionOutput(Protocol):
    """Shows a session. Must return at once."""

    def show_event(self, event: Event) -> None: ...

    def show_trial(self, live: LiveTrial | None) -> None:
        """The running trial, several times a second; None while none runs."""
        ...


class CommandQueue:
    """requests are parsed lines or keys; answers, also those that list the plan, go to the output."""

    def __init__(
        self, requests: asyncio.Queue[Request], output: SessionOutput, list_plan: Callable[[], PlanListed]
    ) -> None:
        self._requests, self._output, self._list_plan = requests, output, list_plan

    @property
    def is_empty(self) -> bool:
        return self._requests.empty()

    async def next(self, within_s: float) -> Command | None:
        """The next valid command; None after within_s seconds, or for an input that is answered here."""
        try:
            request = await asyncio.wait_for(self._requests.get(), within_s)
        except TimeoutError:
            return None
        if isinstance(request, UnknownCommand):
            self.refuse(request)
            return None
        if request.action is Action.HELP:
            self.answer("\n".join(f"{action:8}{meaning}" for action, meaning in MEANINGS.items()))
            return None
        if request.action is Action.TRIALS:
            self._output.show_event(self._list_plan())
            return None
        return request

    def answer(self, sentence: str) -> None:
        self._output.show_event(CommandAnswered(sentence, is_refused=False))

    def refuse(self, error: Exception) -> None:
        self._output.show_event(CommandAnswered(str(error), getattr(error, "code", ""), is_refused=True))

    def refuse_with(self, code: CommandCode, **figures: float | str) -> None:
        self.refuse(CommandRefused(Message(code, figures)))
