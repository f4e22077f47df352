"""False-alarm rate of every finding on clean sessions at 20, 50 and 1000 Hz, and its power at a stated size.

    python -m benchmarks.findings [--sessions 200] [--repeats 2]

Sessions are those of benchmarks/coverage.py. After the findings D1 to D8 the table has the sessions in which a cause is
named. The last two columns are of the published method: mean of its F − k x in the swings and share of negative samples
with the defect: only offsets of force or position make the force of a damper negative throughout, as in Fig. 7 of the
source study.
"""

from __future__ import annotations

import argparse
import math
from collections import Counter
from collections.abc import Iterator

import numpy as np

from benchmarks.coverage import Condition, Session, run
from fitting.cuffs.published_method import fit_published
from fitting.results.codes import FindingCode
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


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sessions", type=int, default=200)
    parser.add_argument("--repeats", type=int, default=2)
    options = parser.parse_args()
    seeds = range(options.sessions)
    false = {
        rate: Counter(
            name for seed in seeds for name in alarms(run(Condition(truth={"force_rate": rate}), seed, options.repeats))
        )
        for rate in RATES
    }
    print("| finding | " + " | ".join(f"false at {rate:g} Hz %" for rate in RATES), end="")
    print(" | size | power % | mean F − k x [N] | negative % |\n|---|---:|---:|---:|---|---:|---:|---:|")
    for code in (*FindingCode, CAUSE):
        cells = [f"{100 * false[rate][str(code)] / options.sessions:.1f}" for rate in RATES]
        cells += (
            [*_power(code, options.sessions, options.repeats)] if isinstance(code, FindingCode) else ["", "", "", ""]
        )
        print(f"| {name_of(code) if isinstance(code, FindingCode) else code} | {' | '.join(cells)} |", flush=True)


def alarms(session: Session) -> Iterator[str]:
    """Findings that are reported, and CAUSE if a cause is named."""
    diagnosis = session.fit.diagnosis
    if diagnosis:
        yield from (str(finding.code) for finding in diagnosis.findings if finding.is_alarm)
        yield from [CAUSE] * bool(diagnosis.causes)


def _power(code: FindingCode, sessions: int, repeats: int) -> Iterator[str]:
    size, condition = DEFECTS[code]
    found = [run(condition, seed, repeats) for seed in range(sessions)]
    published = [fit_published(list(session.fit.pulls.values())) for session in found]
    yield size
    yield f"{100 * np.mean([str(code) in set(alarms(session)) for session in found]):.0f}"
    yield f"{np.mean([fit.damper_force for fit in published if fit.damper_force is not None]):+.1f}"
    yield f"{100 * np.mean([fit.negative_part for fit in published if fit.negative_part is not None]):.0f}"


if __name__ == "__main__":
    main()
