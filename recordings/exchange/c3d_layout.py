"""How a C3D file lays out its frames, from its header: a check on what a reader makes of the parameters.

The numbers of points and analog values are in a C3D file twice, in the header and in the parameters. Where they
differ, one of the two shifts every frame after the first, and only the size of the file shows which.
"""

from __future__ import annotations

import struct
from dataclasses import dataclass
from pathlib import Path

from recordings.errors import ForeignFile, RecordingCode

BLOCK = 512
SIGNATURE = 0x50
INTEL, DEC, MIPS = 84, 85, 86
MOST_COUNTED = 0xFFFF
EXPORT_AGAIN = "open it in the program that wrote it, and export it again"


@dataclass(frozen=True)
class C3dLayout:
    """Layout of the frames by the header.

    size        of the file [bytes]
    start       of the first frame [bytes]
    value_size  2 for integers, 4 for floating point [bytes]
    points, analog_values  of a frame; analog values are those of all channels and samples together
    frames, last_frame     frames count from any number; a last one of 65535 means this one or any later one
    """

    path: Path
    size: int
    start: int
    value_size: int
    points: int
    analog_values: int
    frames: int
    last_frame: int

    def require_agreement(self, points: int, analog_values: int, frames: int) -> None:
        """Raises ForeignFile where these numbers, of the parameters, contradict the header and the size backs that.

        A header that counts channels instead of values is such a case; one of 65535 frames means this number or more.
        """
        if frames != self.frames and self.last_frame < MOST_COUNTED:
            raise ForeignFile(
                f"{self.path} announces {self.frames} frames and holds {frames}; {EXPORT_AGAIN}",
                RecordingCode.FOREIGN_CUT,
            )
        end = self._end(points, analog_values, frames)
        if end > self.size:
            raise ForeignFile(
                f"{self.path} is cut: {frames} frames end at byte {end}, and it has {self.size}; {EXPORT_AGAIN}",
                RecordingCode.FOREIGN_CUT,
            )
        told = self.points, self.analog_values
        if told != (points, analog_values) and self._fits(*told, frames):
            raise ForeignFile(
                f"{self.path} contradicts itself: its header counts {_words(*told)}, its parameters "
                f"{_words(points, analog_values)} a frame; {EXPORT_AGAIN}",
                RecordingCode.FOREIGN_CONTRADICTORY,
            )

    def _fits(self, points: int, analog_values: int, frames: int) -> bool:
        """Whether the frames end with the file, whose last block is filled up."""
        return 0 <= self.size - self._end(points, analog_values, frames) < BLOCK

    def _end(self, points: int, analog_values: int, frames: int) -> int:
        return self.start + frames * (4 * points + analog_values) * self.value_size


def read_c3d_layout(path: Path) -> C3dLayout:
    """Raises ForeignFile where it is no C3D file, or one of a kind of computer that is not read."""
    try:
        with path.open("rb") as file:
            header = file.read(BLOCK)
            file.seek((header[0] - 1) * BLOCK + 3 if header and header[0] else 0)
            processor = file.read(1)
            size = file.seek(0, 2)
    except OSError as error:
        raise ForeignFile(
            f"{path} cannot be read: {error.strerror or error}", RecordingCode.FOREIGN_UNREADABLE
        ) from error
    if len(header) < BLOCK or header[1] != SIGNATURE or not processor:
        raise ForeignFile(
            f"{path} does not begin as a C3D file does; was it renamed, or cut?", RecordingCode.FOREIGN_WRONG_TYPE
        )
    if processor[0] == MIPS:
        raise ForeignFile(
            f"{path} was written on an SGI computer (MIPS numbers), which is not read; {EXPORT_AGAIN}, for Intel",
            RecordingCode.FOREIGN_WRONG_TYPE,
        )
    _, points, analog, first, last, _, scale_first, scale_last, start = struct.unpack("<9H", header[:18])
    sign = scale_first if processor[0] == DEC else scale_last
    return C3dLayout(
        path=path,
        size=size,
        start=(start - 1) * BLOCK,
        value_size=4 if sign & 0x8000 else 2,
        points=points,
        analog_values=analog,
        frames=last - first + 1,
        last_frame=last,
    )


def _words(points: int, analog_values: int) -> str:
    return f"{points} points and {analog_values} analog values"
