"""Write files atomically, and list their hashes where they belong to a session."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from documents.regular_file import replaced
from station.checksums import list_in_session


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file completely, or leave the previous one. Bytes of names that are not UTF-8 are replaced."""
    with drafted(path) as draft:
        draft.write_bytes(content.encode(errors="replace") if isinstance(content, str) else content)


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """A temporary path of the same name; its file replaces `path` when the block ends without an error.

    An OSError names the path, not the temporary one. A file below a session folder is entered into its list of hashes.
    """
    with replaced(path) as draft:
        yield draft
    list_in_session(path)
