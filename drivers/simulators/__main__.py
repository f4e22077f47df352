"""The simulated bench on its own, controlled by lines of JSON: `python -m drivers.simulators`.

The first line on standard input is the options of the bench (bench_from_options); every further line is a request
(requests.py). Each is answered by one line; one that is refused by {"error": "…", "code": "…"}, a sentence and its code
(errors.py). The process ends with its input, and with exit code 2 if the options cannot be used.
"""

from __future__ import annotations

import json
import sys
from typing import Any

from drivers.simulators.errors import refusal
from drivers.simulators.requests import answer_or_refusal, request_from_json
from drivers.simulators.simulated_bench import bench_from_options, describe_bench


def main() -> int:
    # No thread reads: on Windows libraries that load wait for a pending read of a standard handle.
    try:
        with bench_from_options(request_from_json(sys.stdin.readline() or "{}")) as bench:
            _print(describe_bench(bench))
            for line in sys.stdin:
                _print(answer_or_refusal(bench, line))
    except (ValueError, TypeError, OSError, RuntimeError) as error:
        _print(refusal(error))
        return 2
    return 0


def _print(answer: dict[str, Any]) -> None:
    print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    sys.exit(main())
