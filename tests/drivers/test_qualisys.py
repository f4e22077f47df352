"""The driver, through unmodified qtm_rt, against the simulated QTM and against sockets that misbehave."""

import socket
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers import qualisys
from drivers.device import CaptureControl
from drivers.errors import DeviceCode
from drivers.qualisys_settings import CaptureNote
from drivers.qualisys_wire import MarkerBlocks, MarkerFrame
from drivers.simulators.qtm_server import QualisysSimulator
from fitting.trial.clocks import capture_frames
from recordings.samples import Event, Item, Loss, Samples
from tests.drivers.contract import Bench, DeviceContract, blocks, raises_refusal, read_until
from tests.drivers.other_qtm import COMMAND, DATA, EVENT, PARAMETERS, XML, OtherQtm, frame, packet, proper, two
from tests.drivers.simulated_qtm import (
    driver,
    hang_up_on_everyone,
    is_event,
    numbers,
    opened,
    received,
    simulator,
    values,
    without_events,
)
from tests.links import symlink

SWAPPED = PARAMETERS.replace(b">a<", b">x<").replace(b">b<", b">a<").replace(b">x<", b">b<")
SETTINGS_CHANGED = packet(EVENT, b"\x0b")
SWAPPED_FRAME = frame(2, (2, 0, 0, 0.5), (1, 0, 0, 0.5))


class TestTheContract(DeviceContract):
    @pytest.fixture
    def bench(self) -> Iterator[Bench]:
        with simulator() as quiet, simulator(has_preview=True) as streaming, socket.socket() as unused:
            unused.bind(("127.0.0.1", 0))
            yield Bench(
                device=lambda: driver(streaming.port),
                quiet_device=lambda: driver(quiet.port),
                unreachable_device=lambda: driver(unused.getsockname()[1]),
                lose=lambda: hang_up_on_everyone(streaming),
            )


def test_a_capture_it_starts_is_recorded_from_its_first_frame_to_its_last() -> None:
    with simulator() as qtm, opened(driver(qtm.port, control="start")) as device:
        assert isinstance(device, CaptureControl)
        device.start_capture()
        items = received(device, 300)
        device.stop_capture()
        items += read_until(device, lambda items: any(is_event(item, "capture_stopped") for item in items))
    assert numbers(items) == list(range(1, len(numbers(items)) + 1))
    assert [item.kind for item in items if isinstance(item, Event)] == [
        "connected",
        "capture_started",
        "capture_stopped",
    ]
    assert is_event(items[-1], "capture_stopped")
    device_time_ns = np.concatenate([block.device_time_ns for block in blocks(items, "/markers")])
    assert device_time_ns.tolist() == [10_000_000 * (number - 1) for number in numbers(items)]


def test_it_gives_control_back_and_leaves_the_capture_saved_and_stopping_what_does_not_run_is_no_error() -> None:
    with simulator() as qtm:
        for _ in range(2):  # the second finds nothing in its way
            with opened(driver(qtm.port, control="start")) as device:
                device.stop_capture()
                device.start_capture()
                assert received(device, 10)
            assert not qtm.is_controlled


def test_wanted_labels_come_first_and_all_others_follow() -> None:
    with simulator(has_preview=True, occlusions_per_minute=0, noise_mm=0) as qtm:
        with opened(driver(qtm.port)) as device:
            every = values(received(device, 1))[0]
            labels = device.streams[0].labels
        with opened(driver(qtm.port, wanted_labels=("cuff_1", "anchor_2", "cuff_1"))) as device:
            chosen = values(received(device, 1))[0]
            order = device.streams[0].labels
            assert order[:2] == ("cuff_1", "anchor_2") and sorted(order) == sorted(labels)
    expected = every[[labels.index("cuff_1"), labels.index("anchor_2")], :3]
    assert chosen[:2, :3] == pytest.approx(expected, abs=20.0)  # the body has swayed meanwhile


def test_a_hidden_marker_is_nan_in_all_four_columns() -> None:
    with (
        simulator(has_preview=True, occlusions_per_minute=60.0, mean_occlusion_s=1.0) as qtm,
        opened(driver(qtm.port)) as device,
    ):
        seen = values(received(device, 1500))
    is_missing = np.isnan(seen)
    assert is_missing.any()
    assert np.array_equal(is_missing.any(axis=2), is_missing.all(axis=2))


def test_numbers_that_restart_after_a_preview_are_an_event_and_no_loss() -> None:
    with simulator(has_preview=True) as qtm, opened(driver(qtm.port, control="start")) as device:
        items = received(device, 200)
        device.start_capture()
        items += read_until(device, lambda items: any(is_event(item, "numbering_restarted") for item in items))
    assert not any(isinstance(item, Loss) for item in items)
    for block in blocks(items, "/markers"):
        assert np.all(np.diff(block.sample_numbers.astype(int)) == 1)


@pytest.mark.parametrize(
    ("options", "code"),
    [
        ({"wanted_labels": ("cuff_1", "cuff_9")}, DeviceCode.NO_MARKER),
        ({"control": "start", "password": "guess"}, DeviceCode.REFUSED),
    ],
)
def test_what_qtm_cannot_do_is_refused_in_a_sentence(options: dict[str, Any], code: DeviceCode) -> None:
    with simulator(password="secret") as qtm, raises_refusal(code):  # noqa: S106
        driver(qtm.port, **options).open()


def test_with_ten_clients_connected_the_next_one_is_refused() -> None:
    with simulator() as qtm:
        others = [socket.create_connection(("127.0.0.1", qtm.port)) for _ in range(10)]
        for other in others:
            other.recv(100)  # the welcome: it is counted
        with raises_refusal(DeviceCode.REFUSED):
            driver(qtm.port).open()
        for other in others:
            other.close()


def test_starting_without_control_is_refused_with_what_to_set() -> None:
    with simulator() as qtm, opened(driver(qtm.port)) as device, raises_refusal(DeviceCode.REFUSED):
        device.start_capture()


# Against servers that misbehave


def heard(data: bytes, frames: int, answer: Callable[[bytes], bytes] = proper) -> list[Item]:
    """Items of so many frames from a QTM that sends these bytes after its first frame."""
    with OtherQtm(answer) as qtm, opened(driver(qtm.port)) as device:
        qtm.send(data)
        return received(device, frames)


def test_a_server_that_accepts_and_is_silent_is_unavailable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qualisys, "CONNECT_TIMEOUT_S", 0.2)
    with socket.create_server(("127.0.0.1", 0)) as mute, raises_refusal(DeviceCode.NO_ANSWER):
        driver(mute.getsockname()[1]).open()


@pytest.mark.parametrize(
    ("settings", "code"),
    [
        (b"", DeviceCode.NO_ANSWER),
        (packet(XML, b"<Q><General><Frequency>100</Frequency></General></Q>\0"), DeviceCode.UNUSABLE_SETTINGS),
    ],
    ids=["no answer", "no labels"],
)
def test_a_server_without_usable_settings_is_refused(
    monkeypatch: pytest.MonkeyPatch, settings: bytes, code: DeviceCode
) -> None:
    if not settings:
        monkeypatch.setattr(qualisys, "COMMAND_TIMEOUT_S", 0.2)
    with (
        OtherQtm(lambda command: settings if command.startswith(b"getparameters") else proper(command)) as qtm,
        raises_refusal(code),
    ):
        driver(qtm.port).open()


@pytest.mark.parametrize("timestamp_us", [2**62, -(2**62)])
def test_a_time_stamp_that_no_recording_can_hold_is_reported_and_its_frame_counted_as_lost(timestamp_us: int) -> None:
    items = heard(two(2) + two(3)[:8] + struct.pack("<q", timestamp_us) + two(3)[16:] + two(4), 3)
    assert numbers(items) == [1, 2, 4]
    (loss,) = (item for item in items if isinstance(item, Loss))
    assert (loss.first_missing, loss.count, loss.last_device_time_ns) == (3, 1, 20_000_000)
    (reported,) = (item.text for item in items if isinstance(item, Event) and item.kind == "unreadable_packet")
    assert reported.endswith(f"frame 3 with a time stamp of {timestamp_us} µs")


def test_skipped_frames_are_a_loss_between_the_blocks_they_parted() -> None:
    before, loss, after = without_events(heard(two(2) + two(6) + two(7), 4))[-3:]
    assert isinstance(before, Samples)
    assert isinstance(after, Samples)
    assert isinstance(loss, Loss)
    assert (loss.cause, loss.first_missing, loss.count, loss.last_device_time_ns) == ("skipped", 3, 3, 20_000_000)


@pytest.mark.parametrize(
    "nonsense",
    [
        packet(77, b"what is this"),
        packet(EVENT, b"\xc8"),
        packet(DATA, struct.pack("<qII", 20_000, 2, 1) + struct.pack("<II", 8, 99)),
        packet(DATA, struct.pack("<qII", 20_000, 2, 1) + struct.pack("<IIIHH", 16, 9, 40, 0, 0)),
        packet(DATA, b"short"),
    ],
    ids=["unknown packet", "unknown event", "unknown component", "fewer markers than announced", "cut field"],
)
def test_a_packet_that_cannot_be_read_is_reported_and_ignored(nonsense: bytes) -> None:
    items = heard(nonsense + nonsense + two(3), 2)
    assert numbers(items) == [1, 3]
    assert sum(is_event(item, "unreadable_packet") for item in items) == 1


@pytest.mark.parametrize("size", [0, 7, 0x7FFFFFFF])
def test_a_length_that_cannot_be_true_ends_the_connection(size: int) -> None:
    with OtherQtm(proper) as qtm, opened(driver(qtm.port)) as device:
        qtm.send(struct.pack("<II", size, DATA))
        with raises_refusal(DeviceCode.UNREADABLE):
            read_until(device, lambda _: False)


def test_packets_that_arrive_in_pieces_are_put_together() -> None:
    with OtherQtm(proper) as qtm, opened(driver(qtm.port)) as device:
        for byte in two(2) + two(3):
            qtm.send(bytes([byte]))
        assert numbers(received(device, 3)) == [1, 2, 3]


def relabelling(parameters: bytes) -> Callable[[bytes], bytes]:
    """A QTM that answers otherwise when it is asked for its settings again."""
    replies = iter([PARAMETERS, parameters])
    return lambda command: packet(XML, next(replies)) if command.startswith(b"getparameters") else proper(command)


def test_when_qtm_reorders_its_labels_every_marker_keeps_its_name() -> None:
    items = heard(SETTINGS_CHANGED + SWAPPED_FRAME, 2, relabelling(SWAPPED))
    assert values(items)[:, :, 0].tolist() == [[1, 2], [1, 2]]
    assert not any(is_event(item, "labels_lost") for item in items)


def test_frames_between_two_changes_of_the_labels_are_lost_rather_than_guessed() -> None:
    items = heard(SETTINGS_CHANGED + SWAPPED_FRAME + SETTINGS_CHANGED + two(3), 2)
    assert numbers(items) == [1, 3]
    assert values(items)[:, :, 0].tolist() == [[1, 2], [1, 2]]
    assert [(item.first_missing, item.count) for item in items if isinstance(item, Loss)] == [(2, 1)]


def test_a_label_that_qtm_loses_is_missing_from_then_on_and_reported() -> None:
    only_b = PARAMETERS.replace(b"<Label><Name>a</Name></Label>", b"")
    items = heard(SETTINGS_CHANGED + frame(2, (2, 0, 0, 0.5)), 2, relabelling(only_b))
    assert np.isnan(values(items)[1]).tolist() == [[True] * 4, [False] * 4]
    assert any(is_event(item, "labels_lost") for item in items)


def test_a_frame_with_another_number_of_markers_than_labels_is_reported_and_missing() -> None:
    odd = (1.0, 0.0, 0.0, 0.5)
    items = heard(frame(2, odd, odd, odd) + frame(3, odd, odd, odd) + two(4), 2)
    assert sum(is_event(item, "unreadable_packet") for item in items) == 1
    assert [(item.first_missing, item.count) for item in items if isinstance(item, Loss)] == [(2, 2)]


def test_dropped_images_of_qtm_are_reported_whenever_a_rate_increases() -> None:
    def dropping(number: int, drop_rate: int, out_of_sync_rate: int) -> bytes:
        whole = two(number)
        return whole[:36] + struct.pack("<HH", drop_rate, out_of_sync_rate) + whole[40:]

    rates = (0, 0), (25, 0), (25, 0), (10, 4), (0, 0)
    items = heard(b"".join(dropping(number, *of) for number, of in enumerate(rates, 2)), 6)
    reported = [item.text for item in items if is_event(item, "images_dropped") and isinstance(item, Event)]
    assert len(reported) == 2
    assert "at frame 3 that 2.5 %" in reported[0]
    assert "0.4 %" in reported[1]


def test_unread_frames_are_dropped_beyond_a_bound_and_counted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(qualisys, "LONGEST_QUEUE", 100)
    with OtherQtm(proper) as qtm, opened(driver(qtm.port)) as device:
        for first in range(2, 302, 50):
            qtm.send(b"".join(two(number) for number in range(first, first + 50)))
            qtm.send(packet(EVENT, b"\x0d"))  # an event delivers what came before it
        inbox = device._connection.inbox  # type: ignore[union-attr]
        with inbox._changed:
            assert inbox._changed.wait_for(lambda: sum(is_event(i, "capture_saved") for i in inbox._items) == 6, 10)
        items = list(device.read(0))
        qtm.send(two(302))
        later = received(device, 1)
    lost = [item for item in items if isinstance(item, Loss)]
    assert {loss.cause for loss in lost} == {"queue_overflow"}
    assert len(numbers(items)) + sum(loss.count for loss in lost) == 301
    assert len(numbers(items)) <= 100
    assert numbers(later) == [302]
    assert not any(isinstance(item, Loss) for item in later)


def test_a_connection_that_breaks_delivers_first_what_had_come() -> None:
    with OtherQtm(proper) as qtm, opened(driver(qtm.port)) as device:
        qtm.send(two(2))
        qtm.client.shutdown(socket.SHUT_RDWR)
        assert numbers(received(device, 2)) == [1, 2]
        with raises_refusal(DeviceCode.DISCONNECTED):
            device.read(5.0)


def frames_taken(*numbers_and_times_us: tuple[int, int], blocks: MarkerBlocks | None = None) -> list[Item]:
    blocks = blocks or MarkerBlocks(("a",), 100.0, "QTM")
    blocks.labels = ("a",)
    for number, timestamp_us in numbers_and_times_us:
        blocks.add(MarkerFrame(number, timestamp_us, bytes(16), drop_rate=0, out_of_sync_rate=0), 0)
    return blocks.take()


def test_frames_that_were_skipped_while_time_passed_are_lost() -> None:
    (before, loss, after) = frames_taken((7, 60_000), (10, 90_000))
    assert isinstance(loss, Loss) and (loss.first_missing, loss.count) == (8, 2)
    assert isinstance(before, Samples) and isinstance(after, Samples)


@pytest.mark.parametrize(
    ("number", "timestamp_us"),
    [(1, 0), (1, 12_110_000), (6620, 12_120_000), (6620, 500), (1213, 12_110_000)],
    ids=[
        "a capture begins",
        "the same, one clock",
        "preview goes on behind a capture",
        "the same, another clock",
        "two numbers a frame",
    ],
)
def test_numbers_that_jump_without_time_have_begun_anew_and_nothing_is_lost(number: int, timestamp_us: int) -> None:
    items = frames_taken((1211, 12_100_000), (number, timestamp_us))
    assert [type(item) for item in items] == [Samples, Event, Samples]
    assert isinstance(items[1], Event) and items[1].kind == "numbering_restarted"


@pytest.mark.parametrize("jump_us", [5_000_000, -3_000_000, 20_000])
def test_time_stamps_that_jump_while_the_numbers_go_on_are_reported(jump_us: int) -> None:
    """As the fit, which takes the frames on one side of the jump only."""
    frames = [(number, 10_000 * number + jump_us * (number > 50)) for number in range(1, 101)]
    before, event, after = frames_taken(*frames)
    assert isinstance(event, Event) and event.kind == "time_stamps_jumped"
    assert isinstance(before, Samples) and isinstance(after, Samples)
    numbers, stamps = np.transpose(frames)
    assert capture_frames(numbers, 1e-6 * stamps, 1e-6 * stamps, 100.0, 0.0) in (slice(0, 50), slice(50, 100))


@pytest.mark.parametrize("microseconds_a_frame", [0, 10, 10_000, 20_000], ids=["none", "ms", "µs", "another rate"])
def test_time_stamps_that_never_agree_with_the_numbers_do_not_jump(microseconds_a_frame: int) -> None:
    frames = [(number, microseconds_a_frame * number) for number in range(1, 101)]
    assert [type(item) for item in frames_taken(*frames)] == [Samples]


def test_what_follows_a_capture_is_counted_anew_even_where_time_jumps_too() -> None:
    blocks = MarkerBlocks(("a",), 100.0, "QTM")
    frames_taken((1800, 18_000_000), blocks=blocks)
    blocks.capture_ended()
    assert [type(item) for item in frames_taken((16878, 168_780_000), blocks=blocks)] == [Event, Samples]
    later = frames_taken((16880, 168_800_000), blocks=blocks)
    assert [type(item) for item in later] == [Loss, Samples], "the jump behind the capture is none, this one is"


# Which capture is the station's own: it ends the one that it left itself, and no other.


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
def capturing_for_another_program(qtm: QualisysSimulator) -> Iterator[None]:
    """A person at the mocap PC records; his capture must go on as it was."""
    began = qtm._server._world.start_capture()
    with opened(driver(qtm.port)) as onlooker:
        received(onlooker, 300)
        yield
        assert qtm._server._world.capture == began


@pytest.mark.parametrize("note_of", [None, "yesterday", "garbage"])
def test_a_capture_that_a_person_began_is_left_alone_and_reported(tmp_path: Path, note_of: str | None) -> None:
    with simulator() as qtm, capturing_for_another_program(qtm):
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
