"""Options of a benchmark from their defaults."""

import argparse
from pathlib import Path
from typing import Any


def parse_options(description: str | None, *, paths: str = "", **defaults: Any) -> argparse.Namespace:
    """Values of the options --name with the type of their default: False for a flag, Path for a path or None.

    paths: "+" or "*" for so many paths without a name, as `paths`. The description is that of the module.
    """
    parser = argparse.ArgumentParser(description=description, formatter_class=argparse.RawDescriptionHelpFormatter)
    if paths:
        parser.add_argument("paths", nargs=paths, type=Path)
    for name, default in defaults.items():
        flag = f"--{name.replace('_', '-')}"
        if default is False:
            parser.add_argument(flag, action="store_true")
        elif default is Path:
            parser.add_argument(flag, type=Path)
        else:
            parser.add_argument(flag, type=type(default), default=default)
    return parser.parse_args()
