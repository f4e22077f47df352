"""False-alarm rate of every finding on clean sessions at 20, 50 and 1000 Hz, and its power at a stated size.

    python -m benchmarks.findings [--sessions 200] [--power 50] [--repeats 2]
    python -m benchmarks.findings --negative 20

Sessions are those of benchmarks/coverage.py. After the findings D1 to D8 the table has the sessions in which a cause is
named. Then follow the causes, each with its size, the sessions in which it is named, and those in which another is.

--negative prints F − k x of the published method, the force of its damper, over so many sessions for each cause that
could make it negative, as in Fig. 7 of the source study, with the findings of at least half of the sessions. The
force of a swing has the weight of the hook and the zero of the cell, 5 N in these sessions.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from benchmarks.coverage import Condition, Session, run
from fitting.cuffs.published_method import fit_published
from fitting.results.codes import CauseCode, FindingCode
from fitting.results.rendering import name_of
from tests.fitting.defects import Rig

RATES = (20.0, 50.0, 1000.0)
CAUSE = "any cause"
DEFECTS = {
    FindingCode.START: ("cuff 2 mm farther in the swing", Condition(rig=Rig(dynamic_shift=2e-3))),
    FindingCode.STIFFNESS_RATIO: ("relaxation of 15 % in 0.3 s", Condition({"fast": (0.15, 0.3)})),
    FindingCode.CURVATURE: ("stiffening with b = 30 /m", Condition({"bend": 30.0})),
    FindingCode.HARMONICS: ("friction of 2 N", Condition({"friction": 2.0})),
    FindingCode.DAMPING_POWER: ("friction of 4 N", Condition({"friction": 4.0})),
    FindingCode.ANGLE: ("swing 25° aside", Condition(rig=Rig(dynamic_angle=math.radians(25.0)))),
    FindingCode.UNLOADED_FORCE: ("zero −23 N in the swing", Condition(rig=Rig(dynamic_zero=-23.0))),
    FindingCode.UNLOADED_POSITION: ("cuff 2 mm farther in the swing", Condition(rig=Rig(dynamic_shift=2e-3))),
    FindingCode.FORCE_NOISE: ("1 N of noise in the swing alone", Condition(rig=Rig(swing_noise=1.0))),
    FindingCode.MARKER_CORRELATION: ("marker noise with 0.05 s of memory", Condition(truth={"marker_memory": 0.05})),
}

CAUSES = {
    CauseCode.STIFFENING: ("stiffening with b = 30 /m", Condition({"bend": 30.0})),
    CauseCode.SLIP: ("slip above 30 N", Condition({"slip_from": 30.0})),
    CauseCode.FRICTION: ("friction of 4 N", Condition({"friction": 4.0})),
    CauseCode.STANDARD_LINEAR_SOLID: ("relaxation of 30 % in 0.3 s", Condition({"fast": (0.3, 0.3)})),
    CauseCode.CREEP: ("creep of 15 % in 15 s", Condition({"slow": (0.15, 15.0)})),
    CauseCode.PULL_DIRECTION: ("swing 25° aside", Condition(rig=Rig(dynamic_angle=math.radians(25.0)))),
    CauseCode.TARE: ("zero −23 N in the swing", Condition(rig=Rig(dynamic_zero=-23.0))),
    CauseCode.ZERO_DRIFT: ("zero −5 N in the swing", Condition(rig=Rig(dynamic_zero=-5.0))),
    CauseCode.DISPLACEMENT_ZERO: ("cuff 2 mm farther in the swing", Condition(rig=Rig(dynamic_shift=2e-3))),
    CauseCode.SKIN: ("skin that moves by 0.05 mm/N", Condition(rig=Rig(skin=0.05e-3))),
}

MIGRATION = 12e-3
SLIPS = Condition({"slip_from": 30.0, "hardening": 47.0 / MIGRATION})
NEGATIVE = {
    "none": Condition(),
    "force 25 ms late": Condition(truth={"lag": -25e-3}),
    "force 25 ms early": Condition(truth={"lag": 25e-3}),
    "friction of 4 N": Condition({"friction": 4.0}),
    "creep of 15 % in 15 s": Condition({"slow": (0.15, 15.0)}),
    "relaxation of 30 % in 0.3 s": Condition({"fast": (0.3, 0.3)}),
    "stiffening with b = 30 /m": Condition({"bend": 30.0}),
    "swing 25° aside": Condition(rig=Rig(dynamic_angle=math.radians(25.0))),
    "zero −23 N in the swing": Condition(rig=Rig(dynamic_zero=-23.0)),
    "migration of 12 mm, x from the start of each record": SLIPS,
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--power", type=int, default=50, help="sessions of each size")
    parser.add_argument("--repeats", type=int, default=2)
    parser.add_argument("--negative", type=int, default=0)
    options = parser.parse_args()
    if options.negative:
        print_negative_forces(options.negative, options.repeats)
        return
    seeds = range(options.sessions)
    false = {
        rate: Counter(
            name for seed in seeds for name in alarms(run(Condition(truth={"force_rate": rate}), seed, options.repeats))
        )
        for rate in RATES
    }
    print("| finding | " + " | ".join(f"false at {rate:g} Hz %" for rate in RATES), end="")
    print(" | size | power % |\n|---|---:|---:|---:|---|---:|")
    for code in (*FindingCode, CAUSE):
        cells = [f"{100 * false[rate][str(code)] / options.sessions:.1f}" for rate in RATES]
        cells += _power(code, options.power, options.repeats) if isinstance(code, FindingCode) else ["", ""]
        print(f"| {name_of(code) if isinstance(code, FindingCode) else code} | {' | '.join(cells)} |", flush=True)
    print("\n| cause | size | named % | another is named % |\n|---|---|---:|---:|")
    for cause, (size, condition) in CAUSES.items():
        named = [causes_of(run(condition, seed, options.repeats)) for seed in range(options.power)]
        own = 100 * np.mean([cause in found for found in named])
        others = 100 * np.mean([bool(found - {cause}) for found in named])
        print(f"| {name_of(cause)} | {size} | {own:.0f} | {others:.0f} |", flush=True)


def alarms(session: Session) -> Iterator[str]:
    """Findings that are reported, and CAUSE if a cause is named."""
    diagnosis = session.fit.diagnosis
    if diagnosis:
        yield from (str(finding.code) for finding in diagnosis.findings if finding.is_alarm)
        yield from [CAUSE] * bool(diagnosis.causes)


def causes_of(session: Session) -> set[CauseCode]:
    return {cause.code for cause in session.fit.diagnosis.causes} if session.fit.diagnosis else set()


def _power(code: FindingCode, sessions: int, repeats: int) -> list[str]:
    size, condition = DEFECTS[code]
    is_found = [str(code) in set(alarms(run(condition, seed, repeats))) for seed in range(sessions)]
    return [size, f"{100 * np.mean(is_found):.0f}"]


def print_negative_forces(sessions: int, repeats: int) -> None:
    print("| cause | mean F − k x [N] | negative % | findings |\n|---|---:|---:|---|")
    for cause, condition in NEGATIVE.items():
        runs = [run(condition, seed, repeats) for seed in range(sessions)]
        counts = Counter(name for session in runs for name in alarms(session) if name != CAUSE)
        found = ", ".join(name_of(FindingCode(name)) for name in counts if counts[name] >= sessions / 2)
        published = [fit_published(list(session.fit.pulls.values())) for session in runs]
        force, part = np.array([(fit.damper_force, fit.negative_part) for fit in published], dtype=float).T
        print(f"| {cause} | {force.mean():+.1f} | {100 * part.mean():.0f} | {found} |", flush=True)
        if condition is SLIPS:
            shifted = force - np.array([fit.stiffness for fit in published], dtype=float) * MIGRATION
            print(f"| the same, x from the start of the first static record | {shifted.mean():+.1f} | | |", flush=True)


if __name__ == "__main__":
    main()
