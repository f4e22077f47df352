"""Where a view in Rerun is written to: an .rrd file, or the viewer at an address."""

from __future__ import annotations

from pathlib import Path

import rerun as rr


def open_stream(name: str, sink: Path | str) -> rr.RecordingStream:
    """A stream of the application `name` to the sink, without Rerun's own timelines."""
    stream = rr.RecordingStream(name)
    stream.set_log_time_enabled(False)
    stream.set_log_tick_enabled(False)
    if isinstance(sink, Path):
        stream.save(sink)
    else:
        stream.connect_grpc(sink)
    return stream
