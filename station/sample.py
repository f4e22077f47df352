"""The sample session of the library: a bounce, a static and a dynamic trial of the hand cuff, on simulated devices.

Its three recordings in station/sample_session are those of `python -m tests.house.one_cuff FOLDER --sample`.
"""

from __future__ import annotations

import os
import shutil
import sys
from importlib.metadata import version
from pathlib import Path

from documents.regular_file import replaced

RECORDINGS = Path(__file__).with_name("sample_session")


def sample_session() -> Path:
    """A session folder to try things on, in the user's cache, where it may be changed: delete it to have it anew.

    Its hand cuff has k = 8520 N/m, c = 210 N s/m and a migration of 12.0 mm; devices and wearer are simulated. Raises
    OSError where the cache cannot be written.
    """
    folder = _cache() / "cuffstation" / version("cuffstation") / "simulated" / "sample"
    for source in sorted(RECORDINGS.glob("*.mcap")):
        kept = folder / source.name
        if not kept.is_file() or kept.stat().st_size != source.stat().st_size:
            with replaced(kept) as draft:
                shutil.copyfile(source, draft)
    return folder


def _cache() -> Path:
    """The folder in which programs of this user keep what they can make again."""
    named = os.environ.get("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME")
    if named:
        return Path(named)
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")
