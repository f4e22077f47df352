"""The disk-full matrix of docs/reliability.md: samples reported as stored, and samples lost, on a full disk.

    python -m benchmarks.disk_full

A trial of 20 s is written by a caller that continues after the first failure. Simulated disks fail after a number of
bytes; the file-size limit and the small disk are those of the system, and are left out if it has none or requires an
administrator (mount -t tmpfs).
"""

from __future__ import annotations

import errno
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from tests.recordings.failing_disks import Claim, disk_with_room, write_trial, write_trial_on_disk_that_goes

SECONDS = 20.0
PLACES = 200


def main() -> None:
    print("| failure | tried | reported at once | later calls that succeeded | samples claimed but missing |")
    print("|---|---:|---:|---:|---:|")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_trial(folder / "whole.mcap", SECONDS)
        size = (folder / "whole.mcap").stat().st_size
        rooms = [size * i // PLACES for i in range(PLACES)]
        _row("disk full (ENOSPC), injected", [_pretended(folder, room, errno.ENOSPC) for room in rooms])
        _row("volume removed (EIO), injected", [_pretended(folder, room, errno.EIO) for room in rooms])
        _row("disk removed with its cache (EROFS), injected", [_goes(folder, room) for room in rooms])
        _row("fsync fails (EIO), injected", [_fails_to_sync(folder, good) for good in range(20)])
        if sys.platform != "win32":
            _row("file size limit (EFBIG)", [_limited(folder, room) for room in rooms])
        small = [_on_small_disk(folder, kilobytes) for kilobytes in range(8, size // 1024, 16)]
        _row("disk full (ENOSPC), a tmpfs", [claim for claim in small if claim])


def _row(what: str, claims: list[Claim]) -> None:
    told = sum(bool(claim.sentence) for claim in claims)
    returned, missing = sum(claim.returned for claim in claims), sum(claim.missing for claim in claims)
    cells = (what, f"{len(claims)} places", f"{told} times", returned, missing)
    print(f"| {' | '.join(map(str, cells)) if claims else what + ' | left out | – | – | –'} |", flush=True)


def _pretended(folder: Path, room: int, error: int) -> Claim:
    return _claim(folder, lambda path: write_trial(path, SECONDS, disk_with_room(room, error)))


def _goes(folder: Path, room: int) -> Claim:
    return _claim(folder, lambda path: write_trial_on_disk_that_goes(path, SECONDS, room, errno.EROFS))


def _fails_to_sync(folder: Path, good: int) -> Claim:
    left = iter(range(good))

    def sync(_: int) -> None:
        if next(left, None) is None:
            raise OSError(errno.EIO, "Input/output error")

    return _claim(folder, lambda path: write_trial(path, SECONDS, sync=sync))


def _limited(folder: Path, room: int) -> Claim:
    import resource

    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, before[1]))
    try:
        return _claim(folder, lambda path: write_trial(path, SECONDS))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)


def _on_small_disk(folder: Path, kilobytes: int) -> Claim | None:
    with _small_disk(folder / "small", kilobytes) as disk:
        return _claim(disk, lambda path: write_trial(path, SECONDS)) if disk else None


@contextmanager
def _small_disk(place: Path, kilobytes: int) -> Iterator[Path | None]:
    place.mkdir(exist_ok=True)
    mount = ["mount", "-t", "tmpfs", "-o", f"size={kilobytes}k", "tmpfs", str(place)]
    try:
        subprocess.run(mount, check=True, capture_output=True)  # noqa: S603
    except (OSError, subprocess.CalledProcessError):
        yield None
        return
    try:
        yield place
    finally:
        subprocess.run(["umount", str(place)], check=True)  # noqa: S603, S607


def _claim(folder: Path, write: Callable[[Path], Claim | None]) -> Claim:
    path = folder / "trial.mcap"
    path.unlink(missing_ok=True)
    claim = write(path)
    if claim is None:
        raise AssertionError("the trial was written, though the disk took not all of it")
    return claim


if __name__ == "__main__":
    main()
