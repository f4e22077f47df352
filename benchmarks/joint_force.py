"""Which assumptions explain the error of the predicted shoulder force: sensitivity, search, cross-validation.

    python -m benchmarks.joint_force [--data ../shared/data/subject] [--lifts S8R_side S8R_back] [--report S8R_front]
                                     [--draws 960] [--seed 1]

Compares with the force measured in a prosthesis (docs/validation.md). Prints, in percent of body weight:

1. one assumption changed at a time, from the published circle, on every repeat of the lifts;
2. physical corrections one after the other, none of them fitted to a force;
3. over variants drawn at random from all assumptions: the error of a repeat, or of a lift, with the variant that is
   best on the others; and the variant that is best on all, which --report applies to lifts that took no part.
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.joint_force_variants import ContactVariant, Lift
from tests.solver.references import SHARED

Array = NDArray[np.float64]

PUBLISHED = ContactVariant()
TANGENTS = (0.3, 0.345, 0.4, 0.5, 0.7, 1.0)
ELLIPSE = (0.34, 0.61)
OF_PUBLICATION: Mapping[str, ContactVariant] = {
    "published, no cone": ContactVariant(rim=None),
    "published circle": PUBLISHED,
    "published ellipse": ContactVariant(rim=ELLIPSE),
}
SENSITIVITY: Mapping[str, Sequence[Mapping[str, Any]]] = {
    "rim": [{"rim": rim} for rim in (None, (0.3, 0.3), (0.345, 0.345), (0.7, 0.7), (1.0, 1.0), ELLIPSE)],
    "cone axis": [{"tilt": tilt} for tilt in ((-10.0, 0.0), (10.0, 0.0), (0.0, -10.0), (0.0, 10.0))],
    "weights": [{"weighting": "strength"}, {"exponent": 3}, {"reserve": 1.0}, {"reserve": 100.0}],
    "masses": [{"arm_masses": "own"}, {"held": -0.2}, {"held": 0.2}],
    "passive curves": [{"passive": 0.0}, {"passive": 0.5}],
    "tendons": [{"fibres": fibres} for fibres in ((0.5, 1.45), (0.6, 1.45), (0.6, 1.3), (0.7, 1.3))],
    "posture": [
        {"is_plane_free": True},
        {"girdle": 1e-3},
        {"girdle": 1e-2},
        {"rotation": -5.0},
        {"rotation": 5.0},
    ],
    "subscapularis": [{"subscapularis": 0.5}],
    "shear penalty, no cone": [{"rim": None, "shear": weight} for weight in (0.1, 1.0, 10.0)],
    "contact penalty": [{"force": 0.1}, {"force": 1.0}],
}
CORRECTIONS: Sequence[tuple[str, Mapping[str, Any]]] = (
    ("published circle", {}),
    ("fibres within 0.6 to 1.3 in the lift", {"fibres": (0.6, 1.3)}),
    ("arm masses of the patient's body mass", {"arm_masses": "own"}),
    ("girdle held, 1e-2 m²/rad²", {"girdle": 1e-2}),
    ("plane of elevation from the markers", {"is_plane_free": True}),
    ("rim of the model's markers", {"rim": (0.345, 0.345)}),
)
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
    parser.add_argument("--report", nargs="*", default=[], help="lifts that the best variant is applied to")
    parser.add_argument("--draws", type=int, default=960)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    began = process_time()
    lifts = [Lift(given.data, name) for name in given.lifts]
    print(f"\n## One assumption at a time\n\n{_titles(lifts)}")
    tried = sum(map(len, SENSITIVITY.values())) + len(CORRECTIONS)
    print(_row("published circle", errors_of(lifts, PUBLISHED)))
    for group, changes in SENSITIVITY.items():
        for change in changes:
            print(
                _row(
                    f"{group}: {_text(change)}".replace(f"{group}: {group}", group),
                    errors_of(lifts, replace(PUBLISHED, **change)),
                )
            )
    print(f"\n## Corrections, one after the other\n\n{_titles(lifts)}")
    corrected = PUBLISHED
    for name, change in CORRECTIONS:
        corrected = replace(corrected, **change)
        print(_row(name, errors_of(lifts, corrected)))
    variants = drawn_variants(given.draws, given.seed)
    errors = np.array([errors_of(lifts, variant) for variant in variants])
    tried += len(variants)
    print(f"\n## Search: {len(variants)} variants drawn; {tried} tried in all, {process_time() - began:.0f} s\n")
    cross_validate(lifts, variants, errors)
    best = variants[int(errors.mean(axis=1).argmin())]
    for name in given.report:
        lift = Lift(given.data, name)
        print(f"\n{_titles([lift])}")
        for title, variant in (("published circle", PUBLISHED), ("corrections", corrected), ("best", best)):
            print(_row(f"{name}, {title}", lift.errors(variant)))


def errors_of(lifts: Sequence[Lift], variant: ContactVariant) -> Array:
    """RMSE of every repeat of every lift (repeats,) [% of body weight]."""
    return np.concatenate([lift.errors(variant) for lift in lifts])


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


def cross_validate(lifts: Sequence[Lift], variants: Sequence[ContactVariant], errors: Array) -> None:
    """Print held-out errors of the variants that are best on the other repeats, and on the other lifts."""
    print(_titles(lifts))
    for name, variant in OF_PUBLICATION.items():
        print(_row(name, errors_of(lifts, variant)))
    repeat, lift = np.arange(errors.shape[1]) % REPEATS, np.arange(errors.shape[1]) // REPEATS
    groups = [("the other repeats of all lifts", repeat), ("the other lifts", lift)]
    for name, group in groups if len(lifts) > 1 else groups[:1]:
        print(_row(f"chosen on {name}", held_out_errors(errors, group)))
    best = int(errors.mean(axis=1).argmin())
    print(_row("chosen on all (not held out)", errors[best]))
    print(f"\nbest on all: {_changes(variants[best])}")


def held_out_errors(errors: Array, group: NDArray[np.intp]) -> Array:
    """Error of every repeat (repeats,) with the variant of least mean error over the other groups.

    errors (variants, repeats); group (repeats,) numbers, at least two different ones.
    """
    found = np.empty(len(group))
    for place in np.unique(group):
        best = int(errors[:, group != place].mean(axis=1).argmin())
        found[group == place] = errors[best, group == place]
    return found


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
