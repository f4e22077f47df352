"""The fault matrix of docs/reliability.md: every fault while all devices stream, in real time.

    python -m benchmarks.faults

Prints a row for every fault: time until it is reported [ms], the event, the losses counted on the streams of 1 kHz,
100 Hz and 10 Hz, and the samples that are neither received nor counted, on the device and on the two others. Then the
effect of every fault of the sync line on a trial, the error when a faulty device is opened, and the time until a fault
that does not end is given up.
"""

from __future__ import annotations

import tempfile
import time
from math import inf
from pathlib import Path

from drivers.catalogue import make_device
from drivers.errors import DeviceError
from drivers.simulators.bench import Bench
from drivers.simulators.faults import fault_from_dict
from drivers.simulators.settings import Settings
from recordings.samples import Event, Item, Loss
from tests.drivers.fault_bench import CASES, STREAMS, Aftermath, Case, FaultBench, device_options, unaccounted
from tests.station import sync_faults

AT_OPENING = (
    ("ni", "refuse"),
    ("ni", "unplug"),
    ("ni", "transfer_aborted"),
    ("ni", "freeze"),
    ("qtm", "full"),
    ("qtm", "restart"),
    ("qtm", "silent"),
)
FOR_GOOD = (("ni", "freeze"), ("qtm", "silent"), ("serial", "unplug"))
GIVEN_UP_BY_S = 60.0
SETTLED_S = 0.1  # until the fault is active in the servers


def main() -> None:
    titles = "device, fault, duration, reported after, reported as, counted as lost, unaccounted, loss in other devices"
    print(f"| {' | '.join(titles.split(', '))} |")
    print("|---|---|---:|---:|---|---|---:|---:|")
    with FaultBench(speed=1.0) as bench:
        for case in CASES:
            print(_row(case, bench.suffer(case)), flush=True)
    print("\n| fault of the sync line | reported after | event | trial | synchronisation |")
    print("|---|---:|---|---|---|")
    for case in sync_faults.CASES:
        print(_sync_row(case), flush=True)
    print("\n| device | fault when it is opened | refused after | message |")
    print("|---|---|---:|---|")
    for device, fault in AT_OPENING:
        print(_opening_row(device, fault), flush=True)
    print("\n| device | fault that does not end | time-out after |")
    print("|---|---|---:|")
    for row in _rows_given_up():
        print(row)


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


def _sync_row(case: sync_faults.Case) -> str:
    with tempfile.TemporaryDirectory() as folder:
        suffered = sync_faults.suffer(case, Path(folder), speed=1.0)
    after_s, certificate = suffered.told_after_s, suffered.certificate
    named = [finding.split(";")[0] for finding in certificate.findings] if certificate else []
    cells = [
        case.name,
        "–" if after_s is None else f"{1000 * after_s:.0f} ms",
        case.event.replace("_", " ") or "–",
        "accepted" if suffered.result.accepted else "not accepted",
        suffered.words
        if certificate is None
        else "; ".join([f"good to {1e3 * certificate.errors.time:.2f} ms", *named]),
    ]
    return f"| {' | '.join(cells)} |"


def _opening_row(device: str, fault: str) -> str:
    with Bench(Settings()) as bench:
        bench.world.faults.inject(fault_from_dict({"device": device, "fault": fault, "for_s": inf}))
        time.sleep(SETTLED_S)
        opened = make_device(host_clock=time.time_ns, **device_options(bench.ports)[device])
        began_s = time.monotonic()
        try:
            opened.open()
            refusal = "not refused"
        except DeviceError as error:
            refusal = str(error)
        took_ms = 1000 * (time.monotonic() - began_s)
        opened.close()
        for port in bench.ports.values():
            refusal = refusal.replace(str(port), "…")
    return f"| {device} | {fault.replace('_', ' ')} | {took_ms:.0f} ms | {refusal} |"


def _rows_given_up() -> list[str]:
    with FaultBench(speed=1.0) as bench:
        for device, fault in FOR_GOOD:
            bench.world.faults.inject(fault_from_dict({"device": device, "fault": fault, "for_s": inf}))
        began_s, after_s = time.monotonic(), dict[str, float]()
        while len(after_s) < len(FOR_GOOD) and time.monotonic() < began_s + GIVEN_UP_BY_S:
            for device, _ in FOR_GOOD:
                if bench.listeners[device].error is not None:
                    after_s.setdefault(device, time.monotonic() - began_s)
            time.sleep(0.01)
        return [
            f"| {device} | {fault} | {f'{after_s[device]:.1f} s' if device in after_s else 'never'} |"
            for device, fault in FOR_GOOD
        ]


def _word(item: Event | Loss) -> str:
    return (item.kind if isinstance(item, Event) else item.cause).replace("_", " ")


def _lost(items: list[Item]) -> int:
    return sum(item.count for item in items if isinstance(item, Loss))


if __name__ == "__main__":
    main()
