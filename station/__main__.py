"""The command `station`, also as `python -m station` where the environment's scripts are not on the path.

It imports almost nothing, so that Ctrl-C is handled while the verbs are being imported.
"""

from __future__ import annotations

import sys
from typing import NoReturn

from station.exit_code import ENDED_BY_CTRL_C, INTERRUPTED


def main() -> NoReturn:
    """Import the verbs and run one."""
    try:
        from station.cli import main as run

        run()
    except KeyboardInterrupt:
        print(ENDED_BY_CTRL_C, file=sys.stderr, flush=True)
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
