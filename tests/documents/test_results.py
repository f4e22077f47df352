from dataclasses import dataclass, replace

import numpy as np
import pytest

from documents.results import EqualByFields

GAP = np.array([1.0, np.nan])


@dataclass(frozen=True, eq=False)
class Result(EqualByFields):
    values: object
    name: str = "a"


@pytest.mark.parametrize(
    ("values", "others", "is_equal"),
    [
        (GAP, GAP.copy(), True),
        (GAP, np.array([1.0, 2.0]), False),
        (GAP, np.array([1.0]), False),
        ({"k": GAP}, {"k": GAP.copy()}, True),
        ({"k": GAP}, {"c": GAP.copy()}, False),
        ((GAP, "x"), (GAP.copy(), "x"), True),
        ((GAP,), (GAP, GAP), False),
        (Result(GAP), Result(GAP.copy()), True),
        (Result(GAP), Result(GAP, "b"), False),
        (np.array(["a", None], object), np.array(["a", None], object), True),
        (float("nan"), float("nan"), True),
        (1.0, 2.0, False),
        (None, GAP, False),
    ],
)
def test_results_are_equal_if_all_their_fields_are(values: object, others: object, is_equal: bool) -> None:
    assert (Result(values) == Result(others)) is is_equal


def test_another_type_or_field_is_not_equal_and_there_is_no_hash() -> None:
    result = Result(GAP)
    assert result != 1
    assert result != replace(result, name="b")
    with pytest.raises(TypeError, match="unhashable"):
        hash(result)
