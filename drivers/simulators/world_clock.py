"""World time of the simulated bench: it moves in steps, and only as far as every attached station allows.

An attached station sets the time to which the world may advance, and sets the next one when it has processed all data
up to that time. So a run gives the same samples and arrival times on any machine, however busy. Clients that are not
attached cannot report what they have processed: for them the world keeps the pace of the wall clock, times `speed`, and
slows down if a client does not read its data.
"""

from __future__ import annotations

import logging
import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Protocol

from drivers.errors import DeviceError

LONGEST_STEP_S = 0.5  # world
TICK_S = 0.008  # wall; between two steps of a world without an attached station
CATCH_UP_S = 0.1  # wall; a longer delay is not caught up: the world is then slower than its pace
RATE_WINDOW_S = 5.0  # wall
DROP_AFTER_S = 10.0  # wall; a client that reads nothing for this time is dropped
IDLE_TIMEOUT_S = 60.0  # wall; an attached station without a request for this time is detached

logger = logging.getLogger(__name__)


class ClockStopped(DeviceError):
    """The world has ended, or the station was detached; one sentence."""


class Follower(Protocol):
    """A device of the bench, which the clock advances step by step."""

    def step(self, now: float) -> None:
        """Send its clients all data up to now [world s]."""
        ...

    def find_slow_client(self) -> str | None:
        """Description of a client that does not read its data; None without one."""
        ...

    def drop_slow_client(self) -> None:
        """Disconnect the client, so that the world can advance, and log it."""
        ...


class Attachment:
    """An attached station, which limits the advance of the world; created by WorldClock.attach()."""

    def __init__(self, clock: WorldClock, name: str) -> None:
        self.name = name
        self._clock = clock

    def advance_to(self, until: float) -> float:
        """Return when the world has reached `until` [world s], with the time then.

        Other stations and the pace may delay this. Raises ClockStopped.
        """
        return self._clock._advance(self, until)


class WorldClock:
    """Thread-safe. speed: world seconds per wall second at most; None is as fast as the attached stations process data.

    Without a station and without a speed the world stands still.
    """

    def __init__(self, speed: float | None = 1.0, wall: Callable[[], float] = time.perf_counter) -> None:
        self._speed = speed
        self._wall = wall
        self._now = 0.0
        self._changed = threading.Condition()
        self._followers: tuple[Follower, ...] = ()
        self._goals: dict[Attachment, tuple[float, float]] = {}  # goal [world s], and since when it is reached [wall s]
        self._paces: dict[Attachment, float] = {}
        self._due = 0.0, wall()  # a world time and the wall time at which it was due
        self._behind_since_s: float | None = None
        self._history: deque[tuple[float, float]] = deque()
        self._mover: threading.Thread | None = None
        self._failure: str | None = None

    def now(self) -> float:
        """World time [s]."""
        return self._now

    @property
    def has_stations(self) -> bool:
        """Whether a station is attached."""
        return bool(self._goals)

    @property
    def has_ended(self) -> bool:
        """Whether the world moves no more."""
        return self._failure is not None

    @property
    def speed(self) -> float | None:
        """The slowest pace that an attached station has set; without one, the clock's own."""
        paces = tuple(self._paces.values())
        return min(paces) if paces else self._speed

    @speed.setter
    def speed(self, speed: float | None) -> None:
        with self._changed:
            self._speed = speed
            self._due = self._now, self._wall()
            self._changed.notify_all()

    def rate(self) -> float | None:
        """Recent world seconds per wall second; None before the first step."""
        with self._changed:
            if not self._history:
                return None
            wall_s, world_s = self._history[0]
            passed_s = self._wall() - wall_s
            return (self._now - world_s) / passed_s if passed_s > 0 else None

    def follow(self, follower: Follower) -> None:
        """From now on every step also reaches this device, after the earlier ones."""
        with self._changed:
            self._followers = (*self._followers, follower)
            self._ensure_mover()

    def unfollow(self, follower: Follower) -> None:
        with self._changed:
            self._followers = tuple(one for one in self._followers if one is not follower)
            self._changed.notify_all()

    @contextmanager
    def attach(self, name: str = "station", speed: float | None = None) -> Iterator[Attachment]:
        """Within this context the world advances only as far as the station allows, at this pace at most."""
        station = Attachment(self, name)
        with self._changed:
            self._goals[station] = self._now, self._wall()
            if speed is not None:
                self._paces[station] = speed
            self._due = self._now, self._wall()
            self._ensure_mover()
        try:
            yield station
        finally:
            with self._changed:
                self._goals.pop(station, None)
                self._paces.pop(station, None)
                self._due = self._now, self._wall()
                self._changed.notify_all()

    def advance(self, seconds: float) -> float:
        """Advance the world by `seconds`; returns the time then. Raises ClockStopped."""
        with self.attach("advance") as station:
            return station.advance_to(self._now + seconds)

    def stop(self) -> None:
        """Stop the world: every waiting or later call raises ClockStopped."""
        with self._changed:
            self._failure = self._failure or "the simulated bench has ended"
            self._changed.notify_all()

    def _advance(self, station: Attachment, until: float) -> float:
        with self._changed:
            self._ensure_attached(station)
            self._goals[station] = until, self._wall()
            self._changed.notify_all()
            while self._now < until:
                self._ensure_attached(station)
                self._changed.wait(1.0)
            self._goals[station] = self._now, self._wall()
            return self._now

    # Everything below is called with the condition held

    def _ensure_attached(self, station: Attachment) -> None:
        if self._failure is not None:
            raise ClockStopped(self._failure)
        if station not in self._goals:
            raise ClockStopped(f"{station.name} was idle for {IDLE_TIMEOUT_S:g} s and was detached")

    def _ensure_mover(self) -> None:
        if self._mover is None:
            self._mover = threading.Thread(target=self._move, name="world clock", daemon=True)
            self._mover.start()

    def _move(self) -> None:
        """Run in a separate thread while there is anything to advance."""
        try:
            with self._changed:
                while (self._followers or self._goals) and self._failure is None:
                    self._changed.wait(self._step_or_wait())
                self._mover = None
        except Exception as error:
            logger.exception("the simulated bench failed")
            with self._changed:
                self._failure = f"the simulated bench failed: {type(error).__name__}: {error}"
                self._changed.notify_all()

    def _step_or_wait(self) -> float | None:
        """Make the next step, or return the time to wait for it [wall s]; 0 to check again at once."""
        self._detach_the_idle()
        goal = self._goal()
        if goal is None:
            return 1.0 if self._goals else None
        wait_s = self._wait_s(goal)
        if wait_s > 0:
            return wait_s
        if self._is_held_back():
            return TICK_S
        self._make_step(goal)
        return 0.0

    def _goal(self) -> float | None:
        """End of the next step; None while a station holds the world."""
        if self._goals:
            until = min(goal for goal, _ in self._goals.values())
            if until <= self._now:
                return None
            return min(until, self._now + LONGEST_STEP_S) if self._followers else until
        speed = self.speed
        return None if speed is None else self._now + min(TICK_S * speed, LONGEST_STEP_S)

    def _wait_s(self, goal: float) -> float:
        """Wall seconds until the step is due at the world's pace."""
        speed = self.speed
        if speed is None:
            return 0.0
        world_s, wall_s = self._due
        return wall_s + (goal - world_s) / speed - self._wall()

    def _make_step(self, goal: float) -> None:
        late_s = -self._wait_s(goal)
        self._due = goal, self._wall() - min(late_s, CATCH_UP_S)  # the time that the step takes does not slow the world
        self._now = goal
        for follower in self._followers:
            follower.step(goal)
        wall_s = self._wall()
        self._history.append((wall_s, goal))
        while wall_s - self._history[0][0] > RATE_WINDOW_S:
            self._history.popleft()
        self._changed.notify_all()

    def _is_held_back(self) -> bool:
        """Whether the world waits for a client to read its data; a client that reads nothing is dropped."""
        for follower in self._followers:
            who = follower.find_slow_client()
            if who is None:
                continue
            self._behind_since_s = self._wall() if self._behind_since_s is None else self._behind_since_s
            if self._wall() - self._behind_since_s < DROP_AFTER_S:
                return True
            logger.warning("simulated bench: %s has read nothing for %g s and is dropped", who, DROP_AFTER_S)
            follower.drop_slow_client()
            self._behind_since_s = None
        self._behind_since_s = None
        return False

    def _detach_the_idle(self) -> None:
        for station, (goal, since_s) in tuple(self._goals.items()):
            if goal <= self._now and self._wall() - since_s > IDLE_TIMEOUT_S:
                logger.warning("simulated bench: %s was idle for %g s and is detached", station.name, IDLE_TIMEOUT_S)
                del self._goals[station]
                self._paces.pop(station, None)
                self._changed.notify_all()
