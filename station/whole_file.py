"""Write files atomically."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from documents.regular_file import replace_file


def write_whole(path: Path, content: str | bytes) -> None:
    """Write a file completely, or leave the previous one. Bytes of names that are not UTF-8 are replaced."""
    with drafted(path) as draft:
        draft.write_bytes(content.encode(errors="replace") if isinstance(content, str) else content)


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """A temporary path of the same name; its file replaces `path` when the block ends without an error.

    An OSError names the path, not the temporary one.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        # a virus scanner may still read the draft when its folder is removed
        with tempfile.TemporaryDirectory(prefix=".draft-", dir=path.parent, ignore_cleanup_errors=True) as folder:
            draft = Path(folder) / path.name
            yield draft
            replace_file(draft, path)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
