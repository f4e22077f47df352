"""Wrote format_1_body.mcap on 2026-11-22, the first recording with the topics 9 to 12. The file is never made again.

Run as `python -m tests.recordings.golden.make_format_1_body FILE.mcap` it writes such a file with the code of today.
"""

import sys
from pathlib import Path

import numpy as np

from recordings.manifest import BodyMarkers, EmgAmplifier, LoadCell, Manifest, MeasurementProtocol, TrialOutcome
from recordings.samples import Samples, Stream
from recordings.writer import RecordingWriter

START_NS = 1_795_300_000_000_000_000
LABELS = ("ij", "c7", "ac", "ec", "cuff_1")
OUTLET = "LSL outlet amplifier at lab-pc"
STREAMS = (
    Stream("/force", "V", ("force",), 1000.0, "NI Dev1/ai0 (127.0.0.1:31763)", "01A2B3C4"),
    Stream("/sync", "V", ("sync",), 1000.0, "NI Dev1/ai1 (127.0.0.1:31763)", "01A2B3C4"),
    Stream("/markers", "mm", LABELS, 100.0, "QTM 127.0.0.1:22223"),
    Stream("/emg", "uV", ("deltoid_anterior", "trapezius_superior"), 2000.0, OUTLET, "AMP-7"),
    Stream("/emg_sync", "count", ("trigger",), 2000.0, OUTLET, "AMP-7"),
    Stream("/emg_clock", "s", ("offset", "uncertainty"), 0.2, OUTLET, "AMP-7"),
    Stream("/analog", "V", ("goniometer",), 1000.0, "NI Dev1/ai2 (127.0.0.1:31763)", "01A2B3C4"),
)
MANIFEST = Manifest(
    cuff=None,
    body=BodyMarkers(LABELS[:4], LABELS[4:], arm=("ac", "ec"), trunk=("ij", "c7"), is_cord_measured=True),
    condition="tight",
    test="motion",
    repeat=2,
    run=2,
    donning="1",
    start="sync_edge",
    sync_threshold_v=2.5,
    load_cell=LoadCell("daq", 98.0665, 1, "LSB-0815"),
    emg=EmgAmplifier("lsl", {"deltoid_anterior": 1.0}, sync_threshold=0.5, lag_s=-0.048, lag_sd_s=0.001),
    protocol=MeasurementProtocol(pose_s=5.0, cycles=5),
    start_utc_ns=START_NS,
)
AMPLIFIER_AHEAD_NS = 7_000_000_000  # of the station's clock less START_NS


def write_golden(path: Path) -> None:
    """A fifth of a second: the sync line rises at 0.1 s, in /emg_sync too."""
    writer = RecordingWriter(path, MANIFEST, STREAMS)
    for first_ms in (0, 100):
        arrival_ns = START_NS + (first_ms + 104) * 1_000_000
        daq = np.arange(first_ms, first_ms + 100, dtype=np.uint64)
        level = np.full((100, 1), 5.0 if first_ms else 0.0)
        for stream, values in (("/force", level / 50), ("/sync", level), ("/analog", level - 2.5)):
            writer.write(Samples(stream, daq, daq.astype(np.int64) * 1_000_000, arrival_ns, values))
        emg = np.arange(2 * first_ms, 2 * first_ms + 200, dtype=np.uint64)
        emg_ns = emg.astype(np.int64) * 500_000 + AMPLIFIER_AHEAD_NS
        columns = np.stack([emg * 0.25, -(emg * 0.5)], axis=1)
        writer.write(Samples("/emg", emg, emg_ns, arrival_ns, columns))
        writer.write(Samples("/emg_sync", emg, emg_ns, arrival_ns, np.full((200, 1), float(first_ms > 0))))
        frames = np.arange(first_ms // 10 + 1, first_ms // 10 + 11, dtype=np.uint64)
        points = np.tile(np.arange(20, dtype=np.float32).reshape(5, 4), (10, 1, 1))
        writer.write(Samples("/markers", frames, frames.astype(np.int64) * 10_000_000, arrival_ns, points))
    clock_ns = np.array([AMPLIFIER_AHEAD_NS + 150_000_000])
    offset = np.array([[-7.0, 1e-4]])
    writer.write(Samples("/emg_clock", np.zeros(1, np.uint64), clock_ns, START_NS + 150_000_000, offset))
    writer.close(TrialOutcome(accepted=True, state="closed", sentence="the mocap capture ended"))


if __name__ == "__main__":
    write_golden(Path(sys.argv[1]))
