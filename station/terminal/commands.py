"""What an operator can ask of a session without a page: one word a line, or its letter as a key."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from station.errors import StationError


class Action(StrEnum):
    """The letters of keep, redo, don anew, arm, mark, stop and silence are those of the console's page."""

    KEEP = "keep"
    REDO = "redo"
    REDON = "redon"
    UNDO = "undo"
    SKIP = "skip"
    PAUSE = "pause"
    ARM = "arm"
    MARK = "mark"
    STOP = "stop"
    SILENCE = "silence"
    FINISH = "finish"
    END = "end"
    HELP = "help"


KEYS = {
    "k": Action.KEEP,
    "r": Action.REDO,
    "d": Action.REDON,
    "u": Action.UNDO,
    "n": Action.SKIP,
    "p": Action.PAUSE,
    "a": Action.ARM,
    "m": Action.MARK,
    "s": Action.STOP,
    "i": Action.SILENCE,
    "f": Action.FINISH,
    "e": Action.END,
    "?": Action.HELP,
}
MEANINGS = {
    Action.KEEP: "keep the recording that waits",
    Action.REDO: "redo: the recording that waits, runs, or was kept last does not count; say why",
    Action.REDON: "likewise, and don the cuff anew before; its repeats start anew",
    Action.UNDO: "undo the last decision; its recording waits for another one",
    Action.SKIP: "skip the next trial of the plan",
    Action.PAUSE: "pause after the running trial, or at once while none is recorded",
    Action.ARM: "arm: go on after a pause, or try again at once",
    Action.MARK: "mark this moment in the recording",
    Action.STOP: "stop the recording here; it is kept as it is",
    Action.SILENCE: "an alarm was seen",
    Action.FINISH: "finish early: fit, assessment and report of what exists",
    Action.END: "end without a report; the session is resumed with the same command",
    Action.HELP: "this list",
}
TAKES_A_REASON = (Action.REDO, Action.REDON)


class UnknownCommand(StationError):
    """A line that is no command; one sentence."""


@dataclass(frozen=True)
class Command:
    """reason is what was wrong with a recording that is redone; empty: as the station judged it."""

    action: Action
    reason: str = ""


def parse_command(line: str) -> Command:
    """A line such as `redo the wearer coughed`; the letter stands for its word. Raises UnknownCommand."""
    word, _, rest = line.strip().partition(" ")
    action = KEYS.get(word.lower()) or next((known for known in Action if known.value == word.lower()), None)
    if action is None:
        raise UnknownCommand(f"no command is {word[:40]!r}; known are {', '.join(Action)}")
    if rest.strip() and action not in TAKES_A_REASON:
        raise UnknownCommand(f"{action} takes nothing after it, found {rest.strip()[:40]!r}")
    return Command(action, rest.strip())
