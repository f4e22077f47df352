"""Commands of a session without a page: one word per line, or its letter as a key."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from station.errors import StationError
from station.messages.codes import CommandCode
from station.messages.message import Message


class Action(StrEnum):
    """The letters of keep, redo, redon, arm, mark, stop and silence are those of the console page."""

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
    Action.REDO: "repeat the trial of the recording that waits, runs, or was kept last; give the reason",
    Action.REDON: "as redo, after donning the cuff anew; its repeats start again",
    Action.UNDO: "undo the last decision; its recording waits for a decision again",
    Action.SKIP: "skip the next trial of the plan",
    Action.PAUSE: "pause after the running trial, or at once while none is recorded",
    Action.ARM: "arm: continue after a pause, or try again at once",
    Action.MARK: "mark this moment in the recording",
    Action.STOP: "stop the recording; what is recorded so far is kept",
    Action.SILENCE: "silence the alarm",
    Action.FINISH: "finish early: fit, assessment and report of the trials so far",
    Action.END: "end without a report; `station record` resumes the session",
    Action.HELP: "list the commands",
}
TAKES_A_REASON = (Action.REDO, Action.REDON)
LONGEST_QUOTE = 40


class UnknownCommand(StationError):
    """A line or key that is not a command."""


@dataclass(frozen=True)
class Command:
    """reason: fault of a recording that is repeated; empty for the reasons of the verdict."""

    action: Action
    reason: str = ""


def parse_command(line: str) -> Command:
    """Parse a line such as `redo the wearer coughed`, or `r the wearer coughed`. Raises UnknownCommand."""
    word, _, rest = line.strip().partition(" ")
    action = KEYS.get(word.lower()) or next((known for known in Action if known.value == word.lower()), None)
    if action is None:
        figures = {"line": repr(word[:LONGEST_QUOTE]), "known": ", ".join(Action)}
        raise UnknownCommand(Message(CommandCode.UNKNOWN_COMMAND, figures))
    if rest.strip() and action not in TAKES_A_REASON:
        figures = {"action": action.value, "argument": repr(rest.strip()[:LONGEST_QUOTE])}
        raise UnknownCommand(Message(CommandCode.UNEXPECTED_ARGUMENT, figures))
    return Command(action, rest.strip())
