"""What a run of the command line left: its exit code and both its streams."""

from __future__ import annotations


class Ran:
    def __init__(self, code: int, out: str, err: str) -> None:
        self.code, self.out, self.err = code, out, err


def assert_one_sentence(ran: Ran, code: int, *words: str) -> None:
    """The run failed with this code and one line that holds these words."""
    assert ran.code == code, ran.err
    assert ran.out == ""
    assert ran.err.startswith("station: ")
    assert ran.err.count("\n") == 1
    for word in words:
        assert word in ran.err
