"""The fault matrix of docs/reliability.md: every fault while all devices stream, at the wall's own pace.

    python -m benchmarks.faults

Prints a row for each: after how many milliseconds it was first told, as what, what was counted as lost of which stream
at 1 kHz, 100 Hz and 10 Hz, and how many samples nobody accounts for, on the device and on the two others.
"""

from __future__ import annotations

from recordings.samples import Event, Item, Loss
from tests.drivers.fault_bench import CASES, STREAMS, Aftermath, Case, FaultBench, unaccounted


def main() -> None:
    print("| device | fault | lasts | seen after | told as | counted as lost | unaccounted | others lost |")
    print("|---|---|---:|---:|---|---|---:|---:|")
    with FaultBench(speed=1.0) as bench:
        for case in CASES:
            print(_row(case, bench.suffer(case)), flush=True)


def _row(case: Case, aftermath: Aftermath) -> str:
    seen_s = aftermath.seen_after_s
    own = aftermath.items(case.device)
    cells = [
        case.device,
        case.fault.replace("_", " "),
        f"{1000 * case.wall_s:.0f} ms" if case.wall_s else "a moment",
        "–" if seen_s is None else f"{1000 * seen_s:.0f} ms",
        ", ".join(dict.fromkeys(_word(item) for item in own if isinstance(item, Event | Loss))) or "–",
        ", ".join(f"{count} of {stream}" for stream, count in aftermath.lost.items()) or "nothing",
        str(sum(len(unaccounted(own, stream)) for stream in STREAMS[case.device])),
        str(sum(_lost(aftermath.items(device)) for device in STREAMS if device != case.device)),
    ]
    return f"| {' | '.join(cells)} |"


def _word(item: Event | Loss) -> str:
    return (item.kind if isinstance(item, Event) else item.cause).replace("_", " ")


def _lost(items: list[Item]) -> int:
    return sum(item.count for item in items if isinstance(item, Loss))


if __name__ == "__main__":
    main()
