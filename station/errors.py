"""The root of what the station raises; its exit code is that of the verb."""

from __future__ import annotations

from documents.message import Code, Message
from station.exit_code import FAILED, WRONG_USAGE


class StationError(Exception):
    """One sentence for the operator, or the Message that renders it; a second sentence may say what to do."""

    exit_code = FAILED

    def __init__(self, cause: str | Message[Code]) -> None:
        super().__init__(cause)
        self.cause = cause

    @property
    def code(self) -> str:
        """The stable code of the message, for programs; "" if the error has only a sentence."""
        return self.cause.code.value if isinstance(self.cause, Message) else ""


class UnusedOption(StationError):
    """An option of the command line that has no effect on these inputs."""

    exit_code = WRONG_USAGE
