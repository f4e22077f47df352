"""A passive suit worn by a model: a cord from the waist over the shoulder to the arm, on two cuffs that yield.

The waist cuff is anchored to the thorax: the model has no pelvis. What the suit does to the bodies is in cord.py.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from documents.regular_file import LARGEST_SUIT, read_regular
from solver.model import Model
from solver.point_mass import with_point_mass

Array = NDArray[np.float64]

MigrationDirection = Literal["cord", "bone"]
Rate = Literal["backward", "central"]

PARTS = ("waist", "shoulder", "arm")
MOST_REST_LENGTHS = 10_000
BEYOND_MEASURE = 1e12
"""No number of a suit, in any unit, is as large."""
BUNDLED_SUIT = Path(__file__).with_name("suit.toml")


class SuitError(ValueError):
    """A suit that cannot be worn; its text is the sentence to show."""


@dataclass(frozen=True, eq=False)
class SuitPoint:
    """Where the cord meets the suit: location (3,) [m] in a body."""

    body: str
    location: Array


@dataclass(frozen=True, eq=False)
class SuitMass:
    """A cuff as dead weight: mass [kg], center (3,) [m] in the body, inertia (3,) [kg m²] about it, body's axes."""

    body: str
    mass: float
    center: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Suit:
    """A cord, its cuffs' masses, and what to ask of them.

    stiffness [N/m] and damping [N s/m] of the cord
    rest_lengths         (rest lengths,) to try [m];  reference_rest_length [m] at which cuffs are compared
    migration_direction  where a cuff slips to: towards the shoulder point along the "cord", or along the "bone"
    rate                 how rates of cuffs and cord are taken: "backward" (as published) or "central" difference
    groups               name of a group of muscles → its muscles
    """

    waist: SuitPoint
    shoulder: SuitPoint
    arm: SuitPoint
    stiffness: float
    damping: float
    masses: tuple[SuitMass, ...]
    rest_lengths: Array
    reference_rest_length: float
    migration_direction: MigrationDirection = "cord"
    rate: Rate = "backward"
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)


def read_suit(path: Path = BUNDLED_SUIT) -> Suit:
    """Read a suit.toml; raises SuitError naming the key that is missing, unknown or out of range."""
    try:
        document = tomllib.loads(read_regular(path, LARGEST_SUIT).decode("utf-8"))
    except (OSError, ValueError, RecursionError) as error:
        raise SuitError(f"{path} should be a suit in TOML and cannot be read ({error}); correct it") from error
    document = {"migration_direction": "cord", "rate": "backward", "groups": {}} | document
    reference, lengths, cord, masses, direction, rate, groups = _take(
        document,
        path.name,
        *("reference_rest_length_m", "rest_lengths_m", "exotendon", "masses", "migration_direction", "rate", "groups"),
    )
    stiffness, damping, *points = _take(cord, "exotendon", "stiffness_n_per_m", "damping_n_s_per_m", *PARTS)
    waist, shoulder, arm = (_point(table, f"exotendon.{part}") for part, table in zip(PARTS, points, strict=True))
    worn = zip(PARTS, _take(masses, "masses", *PARTS), strict=True)
    return Suit(
        waist=waist,
        shoulder=shoulder,
        arm=arm,
        stiffness=_number(stiffness, "exotendon.stiffness_n_per_m", is_above_zero=True),
        damping=_number(damping, "exotendon.damping_n_s_per_m"),
        masses=tuple(_worn_mass(table, f"masses.{part}") for part, table in worn),
        rest_lengths=_rest_lengths(lengths),
        reference_rest_length=_number(reference, "reference_rest_length_m", is_above_zero=True),
        migration_direction=_one_of(direction, "migration_direction", get_args(MigrationDirection)),
        rate=_one_of(rate, "rate", get_args(Rate)),
        groups=_groups(groups),
    )


def suit_toml(suit: Suit) -> str:
    """The text of a suit.toml that read_suit turns into this suit, to the last digit."""
    first, last = suit.rest_lengths[[0, -1]].tolist()
    lines = [
        f"reference_rest_length_m = {float(suit.reference_rest_length)!r}",
        f"rest_lengths_m = {{ first = {first!r}, last = {last!r}, count = {len(suit.rest_lengths)} }}",
        f'migration_direction = "{suit.migration_direction}"',
        f'rate = "{suit.rate}"',
        "",
        "[exotendon]",
        f"stiffness_n_per_m = {float(suit.stiffness)!r}",
        f"damping_n_s_per_m = {float(suit.damping)!r}",
    ]
    for part in PARTS:
        point = getattr(suit, part)
        lines += ["", f"[exotendon.{part}]", f"body = {_quoted(point.body)}", f"point_m = {point.location.tolist()}"]
    for part, worn in zip(PARTS, suit.masses, strict=True):
        lines += ["", f"[masses.{part}]", f"body = {_quoted(worn.body)}", f"mass_kg = {worn.mass!r}"]
        lines += [f"center_m = {worn.center.tolist()}", f"inertia_kg_m2 = {worn.inertia.tolist()}"]
    lines += ["", "[groups]"]
    lines += [f"{_quoted(name)} = [{', '.join(map(_quoted, members))}]" for name, members in suit.groups.items()]
    return "\n".join(lines) + "\n"


def ensure_fits(suit: Suit, model: Model) -> None:
    """Raises SuitError where a part of the suit is on a body, or a group has a muscle, that the model does not have."""
    bodies, muscles = [body.name for body in model.bodies], model.muscle_names
    places = [(f"exotendon.{part}", getattr(suit, part).body) for part in PARTS]
    places += [(f"masses.{part}", worn.body) for part, worn in zip(PARTS, suit.masses, strict=False)]
    for where, body in places:
        if body not in bodies:
            raise SuitError(
                f"the suit's {where} is on the body {body}, which the model {model.name} does not have; it has "
                f"{', '.join(bodies)}"
            )
    for group, members in suit.groups.items():
        unknown = [name for name in members if name not in muscles]
        if unknown:
            raise SuitError(
                f"the suit's groups.{group} names {', '.join(unknown)}, which the model {model.name} does not have; "
                f"it has {', '.join(muscles)}"
            )


def with_suit_masses(model: Model, suit: Suit) -> Model:
    """The model with the suit's masses lumped into its bodies; the bare body stays as it is."""
    for worn in suit.masses:
        model = with_point_mass(model, worn.body, worn.mass, worn.center)
        index = model.body_index(worn.body)
        body = model.bodies[index]
        loaded = replace(body, inertia=body.inertia + np.diag(worn.inertia))
        model = replace(model, bodies=(*model.bodies[:index], loaded, *model.bodies[index + 1 :]))
    return model


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


def _point(table: Any, where: str) -> SuitPoint:
    body, location = _take(table, where, "body", "point_m")
    return SuitPoint(str(body), _vector(location, f"{where}.point_m"))


def _worn_mass(table: Any, where: str) -> SuitMass:
    body, mass, center, inertia = _take(table, where, "body", "mass_kg", "center_m", "inertia_kg_m2")
    return SuitMass(
        body=str(body),
        mass=_number(mass, f"{where}.mass_kg"),
        center=_vector(center, f"{where}.center_m"),
        inertia=_inertia(inertia, f"{where}.inertia_kg_m2"),
    )


def _rest_lengths(table: Any) -> Array:
    first, last, count = (
        _number(value, "rest_lengths_m") for value in _take(table, "rest_lengths_m", "first", "last", "count")
    )
    if not 0 < first < last or not 5 <= count <= MOST_REST_LENGTHS or count % 1:
        raise SuitError(
            f"the suit's rest_lengths_m should be 5 to {MOST_REST_LENGTHS}, rising from above 0, and are {count:g} "
            f"from {first:g} to {last:g} m; correct it"
        )
    return np.linspace(first, last, int(count))


def _take(table: Any, where: str, *keys: str) -> list[Any]:
    """The values of exactly these keys, in this order."""
    if not isinstance(table, dict):
        raise SuitError(f"the suit's {where} should be a table with {', '.join(keys)} and is {table!r}; correct it")
    missing, unknown = [key for key in keys if key not in table], [key for key in table if key not in keys]
    if missing or unknown:
        fault = f"lacks {', '.join(missing)}" if missing else f"has an unknown {', '.join(unknown)}"
        raise SuitError(f"the suit's {where} should have {', '.join(keys)} and {fault}; correct it")
    return [table[key] for key in keys]


def _number(value: Any, where: str, *, is_above_zero: bool = False) -> float:
    if not _is_finite(value) or value < 0 or (is_above_zero and not value):
        wanted = "above 0" if is_above_zero else "that is not negative"
        raise SuitError(f"the suit's {where} should be a number {wanted} and is {value!r}; correct it")
    return float(value)


def _vector(value: Any, where: str) -> Array:
    if not (isinstance(value, list) and len(value) == 3 and all(map(_is_finite, value))):
        raise SuitError(f"the suit's {where} should be three numbers and is {value!r}; correct it")
    return np.array(value, dtype=float)


def _inertia(value: Any, where: str) -> Array:
    inertia = _vector(value, where)
    if inertia.min() < 0:
        raise SuitError(f"the suit's {where} should be three numbers from 0 on and is {value!r}; correct it")
    return inertia


def _is_finite(value: Any) -> bool:
    return type(value) in (int, float) and abs(value) < BEYOND_MEASURE


def _one_of(value: Any, where: str, allowed: tuple[Any, ...]) -> Any:
    if value not in allowed:
        raise SuitError(f"the suit's {where} should be one of {', '.join(allowed)} and is {value!r}; correct it")
    return value


def _groups(table: Any) -> dict[str, tuple[str, ...]]:
    if not isinstance(table, dict):
        raise SuitError(f"the suit's groups should be a table of lists of muscles and is {table!r}; correct it")
    for name, members in table.items():
        if not (isinstance(members, list) and members and all(isinstance(member, str) for member in members)):
            raise SuitError(f"the suit's groups.{name} should be a list of muscles and is {members!r}; correct it")
    return {name: tuple(members) for name, members in table.items()}
