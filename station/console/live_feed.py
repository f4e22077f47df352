"""Live values of the open session, shared by all pages of a console: one subscription, however many pages are open.

The live process never waits for it, and it never waits for a page: a page takes what it can draw.
"""

from __future__ import annotations

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from station.live.published import NAN, LiveScenario, LiveSetup, LiveUpdate, LiveValues
from station.live.subscription import LiveAddress, LiveSubscription, LiveUnreachable, find_address

if TYPE_CHECKING:
    from solver.suit.suit import Suit
    from station.console.body_drawing import BodyDrawing

LOOK_INTERVAL_S = 1.0
"""Wall time between two looks for a live process."""
COMMAND_TIMEOUT_S = 2.0
"""Wall time after which a rest length that was not applied is no longer shown."""
WORN, RIGID, SLACK = "both", "rigid", "slack"
"""Conditions: with the cuffs as fitted, with rigid ones, and with a slack cord."""
SHOWN_S = 20.0
KEPT_POINTS = 600
"""Points of each curve: SHOWN_S at the rate of the live process, and some more."""


@dataclass(frozen=True)
class LivePoint:
    """One point of every curve; efforts in the order of the scenarios, emg_uv in that of the channels."""

    time_s: float
    efforts: tuple[float, ...]
    cord_force_n: float
    measured_n: float
    emg_uv: tuple[float, ...]


class LiveFeed:
    """setup and shown are those of the last live process of the folder, also after its end (is_over).

    shown is the last update with values; latest the last one. points counts the points of history since the set-up.
    """

    def __init__(self, folder: Callable[[], Path | None], clock: Callable[[], float] = time.perf_counter) -> None:
        """folder of the open session, None without one."""
        self._folder_now, self._clock = folder, clock
        self._folder: Path | None = None
        self._subscription: LiveSubscription | None = None
        self._next_look_s = 0.0
        self.setups = 0
        self._reset()

    def _reset(self) -> None:
        self.setup: LiveSetup | None = None
        self.latest: LiveUpdate | None = None
        self.shown: LiveUpdate | None = None
        self.suit: Suit | None = None
        self.drawing: BodyDrawing | None = None
        self.history: deque[LivePoint] = deque(maxlen=KEPT_POINTS)
        self.points = 0
        self.is_over = False
        self._requested: tuple[float, float] | None = None

    @property
    def values(self) -> LiveValues | None:
        return None if self.shown is None else self.shown.values

    @property
    def scenarios(self) -> tuple[LiveScenario, ...]:
        """With their rest lengths as they are now."""
        if self.latest is not None and self.latest.scenarios:
            return self.latest.scenarios
        return () if self.setup is None else self.setup.scenarios

    @property
    def worn(self) -> int | None:
        """Index of the suit as worn: with its fitted cuffs, without any with rigid ones. None without a suit."""
        chosen = (
            index for wanted in (WORN, RIGID) for index, one in enumerate(self.scenarios) if one.condition == wanted
        )
        return next(chosen, None)

    @property
    def slack(self) -> int | None:
        """Index of the reference of all efforts."""
        return next((index for index, one in enumerate(self.scenarios) if one.condition == SLACK), None)

    @property
    def rest_length_m(self) -> float:
        """As last set on any page, otherwise as solved; NaN without a worn suit."""
        if self._requested is not None:
            return self._requested[0]
        return NAN if self.worn is None else self.scenarios[self.worn].rest_length_m

    def set_rest_length(self, rest_length_m: float) -> None:
        """For all pages, from the next solved frame on: of what began at the rest length of the suit as worn.

        So slack, worn and rigid stay comparable, and the further rest lengths that are solved beside them stay.
        """
        if self._subscription is None or self.worn is None or self.setup is None:
            return
        self._requested = rest_length_m, self._clock()
        common = self.setup.scenarios[self.worn].rest_length_m
        for scenario in self.setup.scenarios:
            if scenario.rest_length_m == common:
                self._subscription.set_rest_length(scenario.name, rest_length_m)

    async def poll(self) -> None:
        """Take what has come; look for a live process if there is none. Call it many times a second."""
        if self._folder_now() != self._folder:
            self.close()
            self._folder = self._folder_now()
            self._reset()
        if self._subscription is not None:
            self._take(self._subscription)
        elif self._folder is not None and self._clock() >= self._next_look_s:
            self._next_look_s = self._clock() + LOOK_INTERVAL_S
            address = await asyncio.to_thread(find_address, self._folder)
            if address is not None:
                await self._connect(address)

    async def _connect(self, address: LiveAddress) -> None:
        try:
            subscription = await asyncio.to_thread(LiveSubscription, address)
        except LiveUnreachable:
            return
        self._reset()
        self.setup, self._subscription = subscription.setup, subscription
        self.setups += 1
        self.drawing, self.suit = await asyncio.to_thread(_draw_body, subscription.setup)

    def _take(self, subscription: LiveSubscription) -> None:
        for update in subscription.take():
            self.latest = update
            if update.values is not None:
                self.shown = update
                self.history.append(_point(update.values, self.worn))
                self.points += 1
        if self._requested is not None:
            asked, at_s = self._requested
            solved = self.scenarios[self.worn].rest_length_m if self.worn is not None else NAN
            if abs(solved - asked) < 1e-6 or self._clock() - at_s > COMMAND_TIMEOUT_S:
                self._requested = None
        if subscription.is_over and not self.is_over:
            self.is_over = True
            self.close()

    def close(self) -> None:
        if self._subscription is not None:
            self._subscription.close()
            self._subscription = None


def _draw_body(setup: LiveSetup) -> tuple[BodyDrawing | None, Suit | None]:
    from station.console.body_drawing import prepare_drawing  # the solver: most consoles show no body

    return prepare_drawing(setup)


def _point(values: LiveValues, worn: int | None) -> LivePoint:
    cord_force_n = NAN if worn is None else values.scenarios[worn].cord_force_n
    efforts = tuple(scenario.effort for scenario in values.scenarios)
    return LivePoint(values.time_s, efforts, cord_force_n, values.cord_force_measured_n, values.emg_rms_uv)
