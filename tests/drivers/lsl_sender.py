"""An amplifier's program: a pylsl outlet in a process of its own, `python -m tests.drivers.lsl_sender`.

The first line on standard input describes the outlet, each further line is a command; each is answered by one line:

    {"consumer": 5}    waits 5 s for a consumer; base, if nothing is sent yet, is the time at which it is there
    {"push": 100}      sends so many samples; sample n holds n + k / 10 in channel k and is stamped base + n / rate
    {"rows": [[0, 0, 1]], "stamps_s": [0.5]}    sends these samples, stamped in seconds after base
    {"skip": 50}       so many samples are never sent
    {"back_s": 100}    its clock is set back
"""

from __future__ import annotations

import json
import subprocess
import sys
from types import TracebackType
from typing import Any

RATE_HZ = 1000.0
LABELS = ("deltoid", "trapezius", "trigger")
UNITS = ("microvolts", "microvolts", "count")


class LslSender:
    """A context manager over such a process."""

    def __init__(self, name: str, source_id: str = "amplifier-7", rate_hz: float = RATE_HZ) -> None:
        self.base_s = 0.0
        self.request = {"name": name, "source_id": source_id, "rate_hz": rate_hz}

    def __enter__(self) -> LslSender:
        command = [sys.executable, "-m", "tests.drivers.lsl_sender"]
        self.process = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)  # noqa: S603
        self.ask(**self.request)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.kill()

    def kill(self) -> None:
        self.process.kill()
        self.process.communicate()

    def ask(self, **request: Any) -> dict[str, Any]:
        assert self.process.stdin is not None and self.process.stdout is not None
        self.process.stdin.write(json.dumps(request) + "\n")
        self.process.stdin.flush()
        answer: dict[str, Any] = json.loads(self.process.stdout.readline())
        self.base_s = float(answer.get("base_s", self.base_s))
        return answer


def main() -> None:
    import pylsl

    request = json.loads(sys.stdin.readline())
    rate_hz = request["rate_hz"]
    info = pylsl.StreamInfo(request["name"], "EMG", len(LABELS), rate_hz, pylsl.cf_float32, request["source_id"])
    info.set_channel_labels(list(LABELS))
    info.set_channel_units(list(UNITS))
    info.desc().append_child("acquisition").append_child_value("manufacturer", "Maker").append_child_value(
        "model", "M1"
    )
    outlet, base_s, sent = pylsl.StreamOutlet(info), pylsl.local_clock(), 0
    print(json.dumps({"base_s": base_s}), flush=True)
    for line in sys.stdin:
        match json.loads(line):
            case {"consumer": timeout_s}:
                is_there = outlet.wait_for_consumers(timeout_s)
                base_s = base_s if sent else pylsl.local_clock()
                answer: dict[str, Any] = {"consumer": is_there, "base_s": base_s}
            case {"push": count}:
                for n in range(sent, sent + count):
                    outlet.push_sample([n + k / 10 for k in range(len(LABELS))], base_s + n / rate_hz)
                sent += count
                answer = {"sent": sent}
            case {"rows": rows, "stamps_s": stamps_s}:
                for row, stamp_s in zip(rows, stamps_s, strict=True):
                    outlet.push_sample(row, base_s + stamp_s)
                answer = {"sent": len(rows)}
            case {"skip": count}:
                sent += count
                answer = {"sent": sent}
            case {"back_s": seconds}:
                base_s -= seconds
                answer = {"base_s": base_s}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
