"""Files that are there whole or not at all."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path


def write_whole(path: Path, content: str | bytes) -> None:
    """The whole file or the one that was there before, never half of it.

    What a name that is not UTF-8 left in a text is replaced: the file is read elsewhere.
    """
    with drafted(path) as draft:
        draft.write_bytes(content.encode(errors="replace") if isinstance(content, str) else content)


@contextmanager
def drafted(path: Path) -> Iterator[Path]:
    """A path of the same name to write under; what is there when the block ends well takes the place.

    An OSError names the path, not the draft.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".draft-", dir=path.parent) as folder:
            draft = Path(folder) / path.name
            yield draft
            os.replace(draft, path)  # noqa: PTH105  (says what it does)
    except OSError as error:
        if error.errno is None:
            raise
        raise OSError(error.errno, error.strerror, str(path)) from error
