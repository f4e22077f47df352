"""Run `station` with limits in a fork of this process, once for each line on stdin, for test_documents.py.

What the verbs import is imported once, before the forks: it would take most of their processor time.
"""

import json
import os
import re
import resource
import sys
import traceback
from importlib import import_module
from pathlib import Path
from typing import Any

from station.cli import main

IMPORTED = (
    "station.assessment.rmr",
    "station.bench.check",
    "station.files.export_trial",
    "station.files.info",
    "station.fit",
)


def serve() -> None:
    """Answer each request {words, folder, processor_s, address_space} with {status, processor_s, memory}."""
    for module in IMPORTED:
        import_module(module)
    for line in sys.stdin:
        request = json.loads(line)
        child = os.fork()
        if child == 0:
            _run(request)
        _, status, used = os.wait4(child, 0)
        # ru_maxrss includes the memory of the parent at the fork; it is used for a child that was killed.
        file = Path(request["folder"], "memory")
        memory = int(file.read_text(encoding="utf-8")) if file.exists() else used.ru_maxrss
        answer = {"status": status, "processor_s": used.ru_utime + used.ru_stime, "memory": 1024 * memory}
        print(json.dumps(answer), flush=True)


def _run(request: dict[str, Any]) -> None:
    """Never returns."""
    for name, number in (("out", 1), ("err", 2)):
        os.dup2(os.open(Path(request["folder"], name), os.O_WRONLY | os.O_CREAT | os.O_TRUNC), number)
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    resource.setrlimit(resource.RLIMIT_CPU, (request["processor_s"], request["processor_s"] + 1))
    resource.setrlimit(resource.RLIMIT_AS, (request["address_space"], request["address_space"]))
    sys.argv = ["station", *request["words"]]
    code = 1
    try:
        main()
    except SystemExit as ended:
        code = int(ended.code or 0)
    except BaseException:
        traceback.print_exc()
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        peak = re.search(r"VmHWM:\s*(\d+) kB", Path("/proc/self/status").read_text(encoding="ascii"))
        Path(request["folder"], "memory").write_text(peak[1] if peak else "0", encoding="ascii")
        os._exit(code)


if __name__ == "__main__":
    serve()
