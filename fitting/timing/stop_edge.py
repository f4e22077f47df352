"""Where the sync line may fall within the last frame of a capture."""

from __future__ import annotations

from dataclasses import dataclass, replace

from recordings.manifest import Timing


@dataclass(frozen=True)
class StopWindow:
    """The interval in which the stop edge lies, in seconds from the end of the last frame, with a uniform density.

    earliest, latest  [s] negative before the end of the frame
    frame             [s] the frame period
    is_declared       whether the configuration states it; otherwise both ends are as likely as all between them, and
                      the position may be the same in all trials
    """

    earliest: float
    latest: float
    frame: float
    is_declared: bool

    def shifted(self, frames: int) -> StopWindow:
        """The same window, `frames` frames later."""
        later = frames * self.frame
        return replace(self, earliest=self.earliest + later, latest=self.latest + later)


def stop_window(timing: Timing, frame: float) -> StopWindow:
    """The window that the manifest declares, for a frame period of `frame` [s].

    Qualisys documents that the output MEASUREMENT TIME stays "until the end of the last frame", which is the end of
    its exposure or of its period. So nothing is assumed but the last frame, unless sync.stop_edge states more.
    """
    if timing.stop_edge == "end_of_frame":
        return StopWindow(0.0, 0.0, frame, is_declared=True)
    if timing.stop_edge == "end_of_exposure" and timing.exposure_s is not None:
        before_end = timing.exposure_s - frame
        return StopWindow(before_end, before_end, frame, is_declared=True)
    if timing.stop_edge == "anywhere":
        return StopWindow(-frame, 0.0, frame, is_declared=True)
    return StopWindow(-frame, 0.0, frame, is_declared=False)
