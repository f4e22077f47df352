"""The live outlet seen by an inlet of pylsl (test_outlet.py runs this file in a network of its own)."""

import os
import socket
import stat
import time
from contextlib import suppress
from dataclasses import replace

import pylsl

from station.live.outlet import LslOutlet, OutletRefused, live_columns, live_row
from station.live.published import NAN, LiveDelivery, LiveScenarioValues, LiveValues
from station.messages.live_messages import LiveCode
from tests.refusals import raises_refusal
from tests.station.live.test_server import SETUP
from tests.timeout import scaled_timeout

NAME = "cuffstation live"
AGE_S = 60.0
DELIVERY = LiveDelivery(0.0, 0.15, 0.0, 1, 0, 1, 100.0)


def sockets() -> set[int]:
    """Descriptors of this process that are sockets."""
    found = set()
    for number in range(256):
        with suppress(OSError):
            found |= {number} if stat.S_ISSOCK(os.fstat(number).st_mode) else set()
    return found


def values(frame: int) -> LiveValues:
    solved = LiveScenarioValues("solved", 0.5, 0.0, (0.25,), 12.5 + frame, (1.0, 2.0, NAN))
    return LiveValues(
        frame / 100, frame, "solved", (0.1,), (0.0,), (0.0,), (solved, solved), host_time_s=time.time() - AGE_S
    )


def test_an_inlet_reads_values_labels_and_units_and_the_sockets_are_on_the_loopback_alone() -> None:
    setup = replace(SETUP, emg_channels=("deltoid",))
    before = sockets()
    outlet = LslOutlet(NAME, "loopback")
    began_s = time.perf_counter()
    outlet.begin(setup)
    begin_s = time.perf_counter() - began_s
    devices = set()
    for number in sockets() - before:
        with socket.socket(fileno=os.dup(number)) as one:
            devices.add(one.getsockopt(socket.SOL_SOCKET, socket.SO_BINDTODEVICE, 16).rstrip(b"\0"))
    assert devices == {b"lo"}

    found = pylsl.resolve_byprop("name", NAME, 1, scaled_timeout(10))
    inlet = pylsl.StreamInlet(found[0])
    inlet.open_stream(scaled_timeout(10))
    info = inlet.info(scaled_timeout(10))
    columns = live_columns(setup)
    assert info.channel_count() == len(columns) == len(live_row(setup, values(0)))
    assert info.get_channel_labels() == [column.name for column in columns]
    units = dict(zip(info.get_channel_labels(), info.get_channel_units(), strict=True))
    assert units["worn/cord_force"] == "newtons" and units["measured/emg_rms/deltoid"] == "microvolts"
    assert units["slack/activation/deltoid"] == "normalized"
    assert info.desc().child("processing").child_value("result") == "live"
    assert info.nominal_srate() == pylsl.IRREGULAR_RATE

    for frame in range(3):
        sent_s = time.perf_counter()
        outlet.write(values(frame), DELIVERY)
        sample, stamp = inlet.pull_sample(scaled_timeout(10))
        row = dict(zip(info.get_channel_labels(), sample, strict=True))
        assert row["worn/cord_force"] == 12.5 + frame and row["slack/activation/deltoid"] == 0.25
        excess_s = pylsl.local_clock() - stamp - AGE_S  # the stamp is when the frame was taken, not when it was sent
        # The outlet may be suspended between its two clocks, as this test between sending and receiving.
        assert -begin_s - 1e-3 < excess_s < begin_s + time.perf_counter() - sent_s + 1e-3
    inlet.close_stream()
    outlet.close()


def test_an_unknown_interface_is_refused() -> None:
    with raises_refusal(LiveCode.NO_INTERFACE, kind=OutletRefused):
        LslOutlet(NAME, "no-such-interface").begin(SETUP)
