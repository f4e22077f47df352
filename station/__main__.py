"""`python -m station` is the command `station`, where the environment's scripts are not on the path."""

from __future__ import annotations

from station.cli import main

if __name__ == "__main__":
    main()
