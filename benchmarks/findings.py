"""False-alarm rate of every finding on clean sessions at 20, 50 and 1000 Hz, and its power at a stated size.

    python -m benchmarks.findings [--sessions 200] [--power 50] [--repeats 2]
    python -m benchmarks.findings --negative 20

Sessions are those of benchmarks/coverage.py: clean ones at three rates of the force, then --power sessions with each
defect of a stated size: how often the finding and the cause of the defect are reported, and how often others.

--negative prints F − k x of the published method, the force of its damper, over so many sessions for each cause that
could make it negative, as in Fig. 7 of the source study, with the findings of at least half of the sessions. The
force of a swing has the weight of the hook and the zero of the cell, 5 N in these sessions.
"""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from benchmarks.command_line import parse_options
from benchmarks.coverage import OBLIQUE, Condition, Session, run
from fitting.cuffs.published_method import fit_published
from fitting.results.codes import CauseCode, FindingCode
from fitting.results.sentences import NAMES
from tests.fitting.defects import Rig

RATES = (20.0, 50.0, 1000.0)
SWING_ASIDE, FAR_ZERO = Condition(rig=Rig(dynamic_angle=OBLIQUE)), Condition(rig=Rig(dynamic_zero=-23.0))
NEAR_ZERO, FARTHER = Condition(rig=Rig(dynamic_zero=-5.0)), Condition(rig=Rig(dynamic_shift=2e-3))
REMEMBERED, RELAXATION = Condition(truth={"marker_memory": 0.05}), Condition({"fast": (0.15, 0.3)})
Row = tuple[Condition, FindingCode | None, CauseCode | None]
DEFECTS: dict[str, Row] = {
    "swing 25° aside": (SWING_ASIDE, FindingCode.ANGLE, CauseCode.PULL_DIRECTION),
    "zero −23 N in the swing": (FAR_ZERO, FindingCode.UNLOADED_FORCE, CauseCode.TARE),
    "zero −5 N in the swing": (NEAR_ZERO, FindingCode.UNLOADED_FORCE, CauseCode.ZERO_DRIFT),
    "cuff 2 mm farther in the swing": (FARTHER, FindingCode.UNLOADED_POSITION, CauseCode.DISPLACEMENT_ZERO),
    "1 N of noise in the swing alone": (Condition(rig=Rig(swing_noise=1.0)), FindingCode.FORCE_NOISE, None),
    "marker noise with 0.05 s of memory": (REMEMBERED, FindingCode.MARKER_CORRELATION, None),
    "skin that moves by 0.05 mm/N": (Condition(rig=Rig(skin=0.05e-3)), None, CauseCode.SKIN),
    "creep of 15 % in 15 s": (Condition({"slow": (0.15, 15.0)}), None, CauseCode.CREEP),
    "relaxation of 15 % in 0.3 s": (RELAXATION, FindingCode.STIFFNESS_RATIO, CauseCode.STANDARD_LINEAR_SOLID),
    "friction of 2 N": (Condition({"friction": 2.0}), FindingCode.HARMONICS, CauseCode.FRICTION),
    "friction of 4 N": (Condition({"friction": 4.0}), FindingCode.DAMPING_POWER, CauseCode.FRICTION),
    "slip above 30 N": (Condition({"slip_from": 30.0}), FindingCode.START, CauseCode.SLIP),
    "stiffening with b = 30 /m": (Condition({"bend": 30.0}), FindingCode.CURVATURE, CauseCode.STIFFENING),
}
"""Size of a defect → its condition, and the finding and the cause that are to be reported."""

MIGRATION = 12e-3
SLIPS = Condition({"slip_from": 30.0, "hardening": 47.0 / MIGRATION})
NEGATIVE = {
    "none": Condition(),
    "force 25 ms late": Condition(truth={"lag": -25e-3}),
    "force 25 ms early": Condition(truth={"lag": 25e-3}),
    **{name: DEFECTS[name][0] for name in ("friction of 4 N", "creep of 15 % in 15 s", "stiffening with b = 30 /m")},
    **{name: DEFECTS[name][0] for name in ("swing 25° aside", "zero −23 N in the swing")},
    "relaxation of 30 % in 0.3 s": Condition({"fast": (0.3, 0.3)}),
    "migration of 12 mm, x from the start of each record": SLIPS,
}


def main() -> None:
    options = parse_options(__doc__, sessions=200, power=50, repeats=2, negative=0)
    if options.negative:
        print_negative_forces(options.negative, options.repeats)
        return
    clean = {f"clean at {rate:g} Hz": (Condition(truth={"force_rate": rate}), None, None) for rate in RATES}
    print("| session | number | its finding % | its cause % | another cause % | other findings: % of sessions |")
    print("|---|---:|---:|---:|---:|---|", flush=True)
    for count, rows in ((options.sessions, clean), (options.power, DEFECTS)):
        for name, row in rows.items() if count else ():
            print_row(name, row, [run(row[0], seed, options.repeats) for seed in range(count)])


def print_row(name: str, row: Row, sessions: Sequence[Session]) -> None:
    """Alarms and named causes of sessions with a defect, or of clean ones."""
    _, finding, cause = row
    diagnoses = [session.fit.diagnosis for session in sessions if session.fit.diagnosis]
    alarms = [{found.code for found in one.findings if found.is_alarm} for one in diagnoses]
    causes = [{found.code for found in one.causes} for one in diagnoses]
    part = 100 / len(sessions)
    own = f"{NAMES[finding]} {part * sum(finding in found for found in alarms):.0f}" if finding else ""
    named = f"{part * sum(cause in found for found in causes):.0f}" if cause else ""
    another = part * sum(bool(found - {cause}) for found in causes)
    others = Counter(code for found in alarms for code in found - {finding})
    listed = ", ".join(f"{NAMES[code]} {part * count:.1f}" for code, count in others.most_common()) or "none"
    print(f"| {name} | {len(sessions)} | {own} | {named} | {another:.1f} | {listed} |", flush=True)


def print_negative_forces(sessions: int, repeats: int) -> None:
    print("| cause | mean F − k x [N] | negative % | findings |\n|---|---:|---:|---|")
    for cause, condition in NEGATIVE.items():
        runs = [run(condition, seed, repeats) for seed in range(sessions)]
        findings = [session.fit.diagnosis.findings for session in runs if session.fit.diagnosis]
        counts = Counter(finding.code for one in findings for finding in one if finding.is_alarm)
        found = ", ".join(NAMES[code] for code in counts if counts[code] >= sessions / 2)
        published = [fit_published(list(session.fit.pulls.values())) for session in runs]
        force, part = np.array([(fit.damper_force, fit.negative_part) for fit in published], dtype=float).T
        print(f"| {cause} | {force.mean():+.1f} | {100 * part.mean():.0f} | {found} |", flush=True)
        if condition is SLIPS:
            shifted = force - np.array([fit.stiffness for fit in published], dtype=float) * MIGRATION
            print(f"| the same, x from the start of the first static record | {shifted.mean():+.1f} | | |", flush=True)


if __name__ == "__main__":
    main()
