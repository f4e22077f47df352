"""Lines that are typed or piped in, on Linux and Windows."""

import io
import os
import subprocess
import sys

import pytest

from station import standard_input
from station.standard_input import read_lines


def test_lines_arrive_in_any_pieces_and_bytes_that_are_not_utf_8_are_replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(standard_input, "LONGEST_LINE", 100)  # a pipe of Windows takes 4096 bytes
    reading, writing = os.pipe()
    with os.fdopen(reading, encoding="utf-8") as stream:
        lines = read_lines(stream)
        os.write(writing, b"\xef\xbb\xbfke")
        os.write(writing, b"ep\n\nhang 2\r\n")
        assert [next(lines), next(lines), next(lines)] == ["keep", "", "hang 2\r"]
        os.write(writing, b"it \xc3\xbc \xff\n" + b"x" * 200)
        os.close(writing)
        assert list(lines) == ["it ü �", "x" * 100]


@pytest.mark.parametrize("stream", [None, io.StringIO()], ids=["none", "without a descriptor"])
def test_an_unreadable_standard_input_has_no_lines(stream: io.StringIO | None) -> None:
    assert list(read_lines(stream)) == []


def test_a_library_loads_while_a_line_is_waited_for() -> None:
    """On Windows it would wait for a pending read of the pipe."""
    program = (
        "import sys, threading\n"
        "from station.standard_input import read_lines\n"
        "lines = []\n"
        "thread = threading.Thread(target=lambda: lines.extend(read_lines(sys.stdin)))\n"
        "thread.start()\n"
        "import scipy.linalg\n"
        "print('loaded', flush=True)\n"
        "thread.join()\n"
        "print(lines)\n"
    )
    command = [sys.executable, "-c", program]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:  # noqa: S603
        assert child.stdin is not None and child.stdout is not None
        assert child.stdout.readline().strip() == b"loaded"
        child.stdin.write(b"ni unplug\n")
        child.stdin.close()
        assert child.stdout.read().strip() == b"['ni unplug']"
