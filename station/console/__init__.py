"""The console: pages in a browser, served by NiceGUI.

NiceGUI talks to browsers through python-engineio, which also imports the packages of its clients and of another server
where they are installed. Nothing here uses them, and they take a third of the processor time of the import.
"""

from __future__ import annotations

import sys
from typing import Any

_absent: dict[str, Any] = dict.fromkeys({"aiohttp", "requests", "engineio.async_drivers.tornado"} - sys.modules.keys())
sys.modules.update(_absent)  # an import of None raises ImportError
try:
    import nicegui  # noqa: F401
finally:
    for name in _absent:
        del sys.modules[name]
