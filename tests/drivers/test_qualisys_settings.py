"""Which capture is the station's own: it ends the one that it left itself, and no other."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from drivers.errors import DeviceCode
from drivers.qualisys_settings import CaptureNote
from drivers.simulators.qtm_server import QualisysSimulator
from tests.drivers.contract import raises_refusal
from tests.drivers.other_qtm import COMMAND, EVENT, OtherQtm, packet, proper
from tests.drivers.simulated_qtm import driver, hang_up_on_everyone, opened, received, simulator
from tests.links import symlink


def noted(path: Path, qtm: QualisysSimulator) -> CaptureNote:
    """A note by the simulator's own time, which runs faster than the wall."""
    return CaptureNote(path / "capture", lambda: round(1e9 * qtm._server._world.now()))


@contextmanager
def left_running(qtm: QualisysSimulator, note: CaptureNote) -> Iterator[None]:
    """A capture whose station was killed."""
    killed = driver(qtm.port, control="start", capture_note=note)
    killed.open()
    killed.start_capture()
    received(killed, 10)
    hang_up_on_everyone(qtm)
    yield
    killed.close()


def test_a_capture_that_a_killed_station_left_running_is_saved_and_blocks_no_other(tmp_path: Path) -> None:
    with simulator() as qtm, left_running(qtm, noted(tmp_path, qtm)):
        with opened(driver(qtm.port, control="start", capture_note=noted(tmp_path, qtm))) as device:
            device.start_capture()
            assert received(device, 10)
        assert not qtm.is_controlled
        assert noted(tmp_path, qtm).age_s is None, "all is saved, and nothing of ours runs"


@contextmanager
def capturing_for_somebody(qtm: QualisysSimulator) -> Iterator[None]:
    """A person at the mocap PC records; his capture must go on as it was."""
    began = qtm._server._world.start_capture()
    with opened(driver(qtm.port)) as onlooker:
        received(onlooker, 300)
        yield
        assert qtm._server._world.capture == began


@pytest.mark.parametrize("note_of", [None, "yesterday", "garbage"])
def test_a_capture_that_a_person_began_is_left_alone_and_reported(tmp_path: Path, note_of: str | None) -> None:
    with simulator() as qtm, capturing_for_somebody(qtm):
        note = noted(tmp_path, qtm)
        if note_of:
            yesterday_ns = round(1e9 * (qtm._server._world.now() - 86_400))
            (tmp_path / "capture").write_text(str(yesterday_ns) if note_of == "yesterday" else "soon")
        device = driver(qtm.port, control="start", capture_note=note)
        with raises_refusal(DeviceCode.CAPTURE_NOT_OURS):
            device.open()


@pytest.mark.parametrize("state", [b"\x0a", b"\x06"], ids=["waiting for a trigger", "calibrating"])
def test_a_qtm_that_another_client_uses_is_left_alone(state: bytes) -> None:
    asked: list[bytes] = []

    def busy(command: bytes) -> bytes:
        asked.append(command.split()[0].rstrip(b"\0"))
        answers = {b"takecontrol": packet(COMMAND, b"You are now master\0"), b"getstate": packet(EVENT, state)}
        return answers.get(asked[-1]) or proper(command)

    with OtherQtm(busy) as qtm, raises_refusal(DeviceCode.CAPTURE_NOT_OURS):
        driver(qtm.port, control="start").open()
    assert asked == [b"version", b"qtmversion", b"takecontrol", b"getstate"], "nothing was stopped, saved or made new"


def test_a_start_that_qtm_refuses_leaves_no_note(tmp_path: Path) -> None:
    with simulator() as qtm, opened(driver(qtm.port, control="start", capture_note=noted(tmp_path, qtm))) as device:
        qtm._server._world.start_capture()
        with raises_refusal(DeviceCode.REFUSED):
            device.start_capture()
        received(device, 10)
        assert noted(tmp_path, qtm).age_s is None


def test_a_note_that_is_a_link_writes_to_no_other_file(tmp_path: Path) -> None:
    other = tmp_path / "letter.txt"
    other.write_text("kept")
    symlink(tmp_path / "note", other)
    note = CaptureNote(tmp_path / "note", lambda: 5)
    note.write()
    assert (other.read_text(), note.age_s) == ("kept", 0.0)
