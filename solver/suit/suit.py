"""A passive suit on a model: a cord between two compliant cuffs, over a guide or straight.

Cuffs and guide are called by their places in the bundled suit: waist and arm, and shoulder. On a leg, "arm" is the
end at the fitted cuff, as the shank, and "waist" the other end, as the heel; Suit.names has the words for messages. The
bundled waist cuff is anchored to the thorax: the model has no pelvis. The forces on the bodies are in cord.py.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, ValidationError, model_validator

from documents import validation
from documents.plain_data import PlainDataError, parse_toml
from documents.regular_file import LARGEST_SUIT, describe_failure, read_regular
from documents.validation import Section, Whole, describe_error
from solver.errors import SolverCode, SolverError
from solver.model import Array, Model, with_point_mass

MigrationDirection = Literal["cord", "bone"]
Rate = Literal["backward", "central"]

PARTS = ("waist", "shoulder", "arm")
MOST_REST_LENGTHS = 10_000
BEYOND_MEASURE = 1e12
LARGEST_PLACE, LARGEST_MASS = 10.0, 100.0
"""[m], [kg] Beyond any body and suit, but below a place in millimetres and a mass in grams."""
"""No number of a suit, in any unit, is as large."""
BUNDLED_SUIT = Path(__file__).with_name("suit.toml")


class SuitError(SolverError):
    """A suit that the model cannot wear; the text is the sentence for the user."""

    general_code = SolverCode.SUIT


@dataclass(frozen=True, eq=False)
class SuitPoint:
    """Attachment point of the cord: location (3,) [m] in a body."""

    body: str
    location: Array


@dataclass(frozen=True, eq=False)
class SuitMass:
    """Mass of a cuff: mass [kg], center (3,) [m] in the body, inertia (3,) [kg m²] about it, body's axes."""

    body: str
    mass: float
    center: Array
    inertia: Array


@dataclass(frozen=True, eq=False)
class Suit:
    """A cord, the masses of its cuffs, and the rest lengths and groups of muscles to evaluate.

    stiffness [N/m] and damping [N s/m] of the cord
    rest_lengths         (rest lengths,) to try [m];  reference_rest_length [m] at which cuffs are compared
    migration_direction  where a cuff slips to: towards the shoulder point along the "cord", or along the "bone"
    rate                 how rates of cuffs and cord are taken: "backward" (as published) or "central" difference
    groups               name of a group of muscles → its muscles
    is_straight          the cord has no guide: shoulder is not used
    names                waist, shoulder and arm → names of these places in messages and in the report
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
    is_straight: bool = False
    names: Mapping[str, str] = field(default_factory=lambda: {part: part for part in PARTS})

    @property
    def parts(self) -> tuple[str, ...]:
        """The places where the cord meets the suit, in the order of the cord."""
        return ("waist", "arm") if self.is_straight else PARTS

    @property
    def line(self) -> tuple[SuitPoint, ...]:
        """Attachment points, in the order of the cord."""
        return tuple(getattr(self, part) for part in self.parts)


def read_suit(path: Path = BUNDLED_SUIT) -> Suit:
    """Read a suit.toml. Raises SuitError that names the file and the key that is missing, unknown or out of range."""
    try:
        document = parse_toml(read_regular(path, LARGEST_SUIT))
    except (OSError, PlainDataError) as error:
        raise SuitError(
            f"{path} should be a suit in TOML and cannot be read ({describe_failure(error)}); correct it",
            SolverCode.SUIT_FILE,
        ) from error
    try:
        table = _SuitTable.model_validate(document)
    except ValidationError as error:
        raise SuitError(f"{path}: {describe_error(error)}; correct it", SolverCode.SUIT_KEY) from error
    cord, lengths = table.exotendon, table.rest_lengths_m
    points = {part: (getattr(cord, part) or cord.waist).point() for part in PARTS}
    return Suit(
        **points,
        stiffness=cord.stiffness_n_per_m,
        damping=cord.damping_n_s_per_m,
        masses=tuple(_suit_mass(getattr(table.masses, part), points[part]) for part in PARTS),
        rest_lengths=np.linspace(lengths.first, lengths.last, lengths.count),
        reference_rest_length=table.reference_rest_length_m,
        migration_direction=table.migration_direction,
        rate=table.rate,
        groups=table.groups,
        is_straight=cord.shoulder is None,
        names={part: getattr(table.names, part) for part in PARTS},
    )


def suit_toml(suit: Suit) -> str:
    """The text of a suit.toml that read_suit turns into this suit, to the last digit."""
    first, last = suit.rest_lengths[[0, -1]].tolist()
    lines = [
        f"reference_rest_length_m = {float(suit.reference_rest_length)!r}",
        f"rest_lengths_m = {{ first = {first!r}, last = {last!r}, count = {len(suit.rest_lengths)} }}",
        f'migration_direction = "{suit.migration_direction}"',
        f'rate = "{suit.rate}"',
        f"names = {{ {', '.join(f'{part} = {_quoted(suit.names[part])}' for part in PARTS)} }}",
        "",
        "[exotendon]",
        f"stiffness_n_per_m = {float(suit.stiffness)!r}",
        f"damping_n_s_per_m = {float(suit.damping)!r}",
    ]
    for part in PARTS:
        point = getattr(suit, part)
        if part == "shoulder" and suit.is_straight:
            continue
        lines += ["", f"[exotendon.{part}]", f"body = {_quoted(point.body)}", f"point_m = {point.location.tolist()}"]
    for part, cuff_mass in zip(PARTS, suit.masses, strict=True):
        lines += ["", f"[masses.{part}]", f"body = {_quoted(cuff_mass.body)}", f"mass_kg = {cuff_mass.mass!r}"]
        lines += [f"center_m = {cuff_mass.center.tolist()}", f"inertia_kg_m2 = {cuff_mass.inertia.tolist()}"]
    lines += ["", "[groups]"]
    lines += [f"{_quoted(name)} = [{', '.join(map(_quoted, members))}]" for name, members in suit.groups.items()]
    return "\n".join(lines) + "\n"


def ensure_fits(suit: Suit, model: Model) -> None:
    """Raises SuitError where a part of the suit is on a body, or a group has a muscle, that the model does not have."""
    bodies, muscles = [body.name for body in model.bodies], model.muscle_names
    places = [(f"exotendon.{part}", getattr(suit, part).body) for part in PARTS]
    places += [(f"masses.{part}", cuff_mass.body) for part, cuff_mass in zip(PARTS, suit.masses, strict=False)]
    for where, body in places:
        if body not in bodies:
            raise SuitError(
                f"the suit's {where} is on the body {body}, which the model {model.name} does not have; it has "
                f"{', '.join(bodies)}; give a suit of this model",
                SolverCode.SUIT_BODY,
            )
    for group, members in suit.groups.items():
        unknown = [name for name in members if name not in muscles]
        if unknown:
            raise SuitError(
                f"the suit's groups.{group} names {', '.join(unknown)}, which the model {model.name} does not have; "
                f"it has {', '.join(muscles)}; give a suit of this model",
                SolverCode.SUIT_MUSCLE,
            )


def with_suit_masses(model: Model, suit: Suit) -> Model:
    """The model with the suit's masses lumped into its bodies; the bare body stays as it is."""
    for cuff_mass in suit.masses:
        model = with_point_mass(model, cuff_mass.body, cuff_mass.mass, cuff_mass.center)
        index = model.body_index(cuff_mass.body)
        body = model.bodies[index]
        loaded = replace(body, inertia=body.inertia + np.diag(cuff_mass.inertia))
        model = replace(model, bodies=(*model.bodies[:index], loaded, *model.bodies[index + 1 :]))
    return model


def _suit_mass(table: _MassTable | None, point: SuitPoint) -> SuitMass:
    """A part without a table has no mass."""
    return SuitMass(point.body, 0.0, point.location, np.zeros(3)) if table is None else table.mass()


def _quoted(text: str) -> str:
    return json.dumps(text, ensure_ascii=False)


Number = Annotated[validation.Number, Field(gt=-BEYOND_MEASURE, lt=BEYOND_MEASURE)]
NonNegative = Annotated[Number, Field(ge=0)]
Positive = Annotated[Number, Field(gt=0)]
Coordinate = Annotated[Number, Field(ge=-LARGEST_PLACE, le=LARGEST_PLACE)]
Vector = tuple[Coordinate, Coordinate, Coordinate]
Name = Annotated[str, Field(min_length=1, max_length=40)]


class _PointTable(Section):
    body: str
    point_m: Vector

    def point(self) -> SuitPoint:
        return SuitPoint(self.body, np.array(self.point_m))


class _MassTable(Section):
    body: str
    mass_kg: Annotated[NonNegative, Field(le=LARGEST_MASS)]
    center_m: Vector
    inertia_kg_m2: tuple[NonNegative, NonNegative, NonNegative]

    @model_validator(mode="after")
    def _is_of_a_body(self) -> _MassTable:
        largest, total = max(self.inertia_kg_m2), sum(self.inertia_kg_m2)
        if largest > (1.0 + 1e-6) * (total - largest):
            raise ValueError(f"inertia_kg_m2 has {largest:g}, expected no moment above the sum of the other two")
        return self

    def mass(self) -> SuitMass:
        return SuitMass(self.body, self.mass_kg, np.array(self.center_m), np.array(self.inertia_kg_m2))


class _CordTable(Section):
    stiffness_n_per_m: Positive
    damping_n_s_per_m: NonNegative
    waist: _PointTable
    shoulder: _PointTable | None = None
    arm: _PointTable


class _MassesTable(Section):
    waist: _MassTable | None = None
    shoulder: _MassTable | None = None
    arm: _MassTable | None = None


class _NamesTable(Section):
    waist: Name = "waist"
    shoulder: Name = "shoulder"
    arm: Name = "arm"


class _RestLengthsTable(Section):
    first: Positive
    last: Positive
    count: Annotated[Whole, Field(ge=5, le=MOST_REST_LENGTHS)]

    @model_validator(mode="after")
    def _rises(self) -> _RestLengthsTable:
        if self.first >= self.last:
            raise ValueError(f"from {self.first:g} to {self.last:g} m, expected lengths that rise")
        return self


class _SuitTable(Section):
    """The keys of suit.toml."""

    reference_rest_length_m: Positive
    rest_lengths_m: _RestLengthsTable
    exotendon: _CordTable
    masses: _MassesTable = Field(default_factory=_MassesTable)
    names: _NamesTable = Field(default_factory=_NamesTable)
    migration_direction: MigrationDirection = "cord"
    rate: Rate = "backward"
    groups: dict[str, Annotated[tuple[str, ...], Field(min_length=1)]] = Field(default_factory=dict)
