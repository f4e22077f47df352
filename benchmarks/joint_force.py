"""Which assumptions explain the error of the predicted shoulder force: sensitivity, corrections, search, transfer.

    python -m benchmarks.joint_force [--data ../shared/data/subject] [--lifts S8R_side S8R_back] [--report S8R_front]
                                     [--draws 960] [--seed 1]

Compares with the force measured in a prosthesis (docs/validation.md). Prints, in percent of body weight:

1. one assumption changed at a time, on every repeat of the lifts, from the published circle (and from 2);
2. physical corrections of the body one after the other, none of them fitted to a force; then all of them with every
   cone, where nothing is chosen, and all but one;
3. rules that choose among the subsets of the corrections, or among variants drawn at random from all assumptions, on
   the other direction of lift (joint_force_transfer.py), and how the mean errors of two directions are correlated;
4. the error of a repeat with the drawn variant that is best on the other repeats, and the variant that is best on all.

--report applies the published variants, the corrected body with every cone, and the best variant to further lifts.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import fields, replace
from itertools import product
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.joint_force_transfer import RULES, Predictions, predictions, weight_equally
from benchmarks.joint_force_variants import ContactVariant, Lift
from tests.solver.references import SHARED

Array = NDArray[np.float64]

PUBLISHED = ContactVariant()
TANGENTS = (0.3, 0.345, 0.4, 0.5, 0.7, 1.0)
ELLIPSE = (0.34, 0.61)
CONES: Mapping[str, tuple[float, float] | None] = {
    "no cone": None,
    "circle": (0.5, 0.5),
    "ellipse": ELLIPSE,
    "rim of the markers": (0.345, 0.345),
}
"""The published ones, and the default of `station rmr`."""
SENSITIVITY: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "rim": [{"rim": rim} for rim in (None, (0.3, 0.3), (0.345, 0.345), (0.7, 0.7), (1.0, 1.0), ELLIPSE)],
    "cone axis": [{"tilt": tilt} for tilt in ((-10.0, 0.0), (10.0, 0.0), (0.0, -10.0), (0.0, 10.0))],
    "weights": [
        {"weighting": "strength"},
        {"weighting": "volume"},
        {"exponent": 3},
        {"reserve": 1.0},
        {"reserve": 100.0},
    ],
    "masses": [{"arm_masses": "own"}, {"held": -0.2}, {"held": 0.2}, {"grip": 0.035}],
    "passive curves": [{"passive": 0.0}, {"passive": 0.5}],
    "tendons": [{"fibres": fibres} for fibres in ((0.5, 1.45), (0.6, 1.45), (0.6, 1.3), (0.7, 1.3))],
    "posture": [
        {"is_plane_free": True},
        {"is_forearm_free": True},
        {"is_plane_free": True, "is_forearm_free": True},
        {"is_angle_tracked": True},
        {"girdle": 1e-3},
        {"girdle": 1e-2},
        {"rotation": -5.0},
        {"rotation": 5.0},
    ],
    "subscapularis": [{"subscapularis": 0.5}],
    "shear penalty, no cone": [{"rim": None, "shear": weight} for weight in (0.1, 1.0, 10.0)],
    "contact penalty": [{"force": 0.1}, {"force": 1.0}],
}
CORRECTIONS: Mapping[str, Mapping[str, Any]] = {
    "fibres within 0.6 to 1.3 in the lift": {"fibres": (0.6, 1.3)},
    "arm masses of the patient's body mass": {"arm_masses": "own"},
    "girdle held, 1e-2 m²/rad²": {"girdle": 1e-2},
    "plane of elevation from the markers": {"is_plane_free": True},
    "forearm from the markers": {"is_forearm_free": True},
}
"""Of the body, in a fixed order; in subsets the posture varies slowest, because its solution takes longest."""
BODIES: Mapping[str, Sequence[Any]] = {
    "is_plane_free": (False, True),
    "girdle": (0.0, 1e-3, 1e-2),
    "rotation": (-5.0, 0.0, 5.0),
    "arm_masses": ("published", "own"),
    "fibres": (None, (0.5, 1.45), (0.6, 1.45), (0.6, 1.3), (0.7, 1.3)),
    "subscapularis": (0.5, 1.0),
    "passive": (0.5, 1.0),
}
CONTACTS: Mapping[str, Sequence[Any]] = {
    "rim": (None, *((tangent, tangent) for tangent in TANGENTS), ELLIPSE),
    "tilt": tuple((up, forward) for up in (-10.0, 0.0, 10.0) for forward in (-10.0, 0.0, 10.0)),
    "weighting": ("equal", "strength"),
    "shear": (0.0, 0.1),
}
CONTACTS_PER_BODY = 8
REPEATS = 3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, default=SHARED / "subject", help="files of lifts: docs/validation.md")
    parser.add_argument("--lifts", nargs="+", default=["S8R_side", "S8R_back"])
    parser.add_argument("--report", nargs="*", default=[], help="lifts that took no part")
    parser.add_argument("--draws", type=int, default=960)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    began = process_time()
    lifts, reported = ([Lift(given.data, name) for name in names] for names in (given.lifts, given.report))
    _print_sensitivity(lifts, "published circle", PUBLISHED)
    _print_corrections(lifts)
    _print_sensitivity(lifts, "corrected body, circle", with_changes(CORRECTIONS.values()))
    family = predictions(lifts, corrected_subsets())
    drawn = predictions(lifts, drawn_variants(given.draws, given.seed))
    tried = 2 * sum(map(len, SENSITIVITY.values())) + len(family.variants) + len(drawn.variants)
    for title, found in (("Subsets of the corrections with every cone", family), ("Drawn variants", drawn)):
        print(f"\n## {title}: {len(found.variants)} variants\n\n{_titles(lifts)}")
        for name, rule in RULES.items() if len(lifts) > 1 else ():
            print(_row(f"by the other lifts: {name}", found.transferred_errors(rule)))
        _print_held_out_repeats(found)
        if len(lifts) > 1:
            correlation = found.bias_correlation()
            print(f"correlation of the mean errors of the first two lifts over the variants: {correlation:.2f}")
    print(f"\n{tried} variants tried in all, {process_time() - began:.0f} s")
    best = drawn.variants[int(drawn.errors.mean(axis=1).argmin())]
    for lift in reported:
        _print_report(lift, best)


def errors_of(lifts: Sequence[Lift], variant: ContactVariant) -> Array:
    """RMSE of every repeat of every lift (repeats,) [% of body weight]."""
    return np.concatenate([lift.errors(variant) for lift in lifts])


def corrected_subsets() -> list[ContactVariant]:
    """Every subset of the corrections with every cone."""
    slowest_first = list(CORRECTIONS.values())[::-1]
    variants = []
    for is_taken in product((False, True), repeat=len(slowest_first)):
        body = with_changes(change for change, taken in zip(slowest_first, is_taken, strict=True) if taken)
        variants += [replace(body, rim=rim) for rim in CONES.values()]
    return variants


def with_changes(changes: Iterable[Mapping[str, Any]]) -> ContactVariant:
    """The published circle with these changes."""
    variant = PUBLISHED
    for change in changes:
        variant = replace(variant, **change)
    return variant


def drawn_variants(count: int, seed: int) -> list[ContactVariant]:
    """Drawn uniformly from the levels of all assumptions; several contacts share the mechanics of a body."""
    generator = np.random.default_rng(seed)

    def drawn(levels: Mapping[str, Sequence[Any]]) -> dict[str, Any]:
        return {name: values[int(generator.integers(len(values)))] for name, values in levels.items()}

    variants: list[ContactVariant] = []
    while len(variants) < count:
        body = drawn(BODIES)
        variants += [ContactVariant(**body, **drawn(CONTACTS)) for _ in range(CONTACTS_PER_BODY)]
    return variants[:count]


def held_out_errors(errors: Array, group: NDArray[np.intp]) -> Array:
    """Error of every repeat (repeats,) with the variant of least mean error over the other groups.

    errors (variants, repeats); group (repeats,) numbers, at least two different ones.
    """
    found = np.empty(len(group))
    for place in np.unique(group):
        best = int(errors[:, group != place].mean(axis=1).argmin())
        found[group == place] = errors[best, group == place]
    return found


def _print_sensitivity(lifts: Sequence[Lift], start: str, variant: ContactVariant) -> None:
    print(f"\n## One assumption at a time, from: {start}\n\n{_titles(lifts)}")
    print(_row(start, errors_of(lifts, variant)))
    for group, changes in SENSITIVITY.items():
        for change in changes:
            title = f"{group}: {_text(change)}".replace(f"{group}: {group}", group)
            print(_row(title, errors_of(lifts, replace(variant, **change))))


def _print_corrections(lifts: Sequence[Lift]) -> None:
    """One after the other; all with every cone; all but one, as the mean force of all cones: no cone is chosen."""
    names, changes = list(CORRECTIONS), list(CORRECTIONS.values())
    print(f"\n## Corrections of the body, one after the other, with the circle\n\n{_titles(lifts)}")
    for place, name in enumerate(["published", *names]):
        print(_row(name, errors_of(lifts, with_changes(changes[:place]))))
    print(f"\n## Nothing chosen\n\n{_titles(lifts)}")
    for title, body in (("published body", PUBLISHED), ("corrected body", with_changes(changes))):
        _print_cones(lifts, title, body)
    for place, name in enumerate(names):
        body = with_changes(changes[:place] + changes[place + 1 :])
        print(_row(f"corrected, mean of the cones, without: {name}", _of_all_cones(lifts, body)[1]))


def _print_cones(lifts: Sequence[Lift], title: str, body: ContactVariant) -> None:
    errors, mean_force = _of_all_cones(lifts, body)
    for cone, row in zip(CONES, errors, strict=True):
        print(_row(f"{title}, {cone}", row))
    print(_row(f"{title}, mean force of these cones", mean_force))


def _of_all_cones(lifts: Sequence[Lift], body: ContactVariant) -> tuple[Array, Array]:
    """Errors with every cone (cones, repeats), and those of the mean force (repeats,)."""
    found = predictions(lifts, [replace(body, rim=rim) for rim in CONES.values()])
    return found.errors, found.mean_errors(weight_equally(found.errors, found.changes))


def _print_held_out_repeats(found: Predictions) -> None:
    repeat = np.arange(found.errors.shape[1]) % REPEATS
    print(_row("by the other repeats of all lifts: the best", held_out_errors(found.errors, repeat)))
    best = int(found.errors.mean(axis=1).argmin())
    print(_row("the best on all, not held out", found.errors[best]))
    print(f"\nbest on all: {_changes(found.variants[best])}")


def _print_report(lift: Lift, best: ContactVariant) -> None:
    print(f"\n## {lift.name}, which took no part\n\n{_titles([lift])}")
    _print_cones([lift], "published body", PUBLISHED)
    _print_cones([lift], "corrected body", with_changes(CORRECTIONS.values()))
    print(_row("the best drawn variant", lift.errors(best)))


def _titles(lifts: Sequence[Lift]) -> str:
    titles = [f"{lift.name} {repeat + 1}" for lift in lifts for repeat in range(REPEATS)]
    return f"| | {' | '.join(titles)} | mean |\n|---|{'---:|' * (len(titles) + 1)}"


def _changes(variant: ContactVariant) -> str:
    change = {
        field.name: getattr(variant, field.name)
        for field in fields(variant)
        if getattr(variant, field.name) != getattr(PUBLISHED, field.name)
    }
    return _text(change)


def _text(change: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} {value if value is not None else 'none'}" for name, value in change.items())


def _row(name: str, errors: Array) -> str:
    return f"| {name} | {' | '.join(f'{error:.1f}' for error in errors)} | {errors.mean():.1f} |"


if __name__ == "__main__":
    main()
