"""The mutator changes what decides and nothing else, and its list of harmless mutations is true to the code."""

import pytest

from benchmarks.mutants import list_mutations

pytest.importorskip("resource", reason="the mutator forks, which Windows does not")

from benchmarks.mutations import MODULES, ROOT, find_tests, harmless_mutations

SOURCE = '''
"""Docstring with 1 number."""

@dataclass(frozen=True)
class Limit:
    most: Literal["all"] | float = 0.5

    def exceeds(self, force: float, unit: str) -> bool:
        if unit == "N" and force > self.most:
            return True
        return not min(force, 10) < 0

    def twice(self) -> float:
        raise_if(f"{self.most:3d} {2}", "message")
        return 2.0 * -self.most
'''


def test_every_operator_comparison_condition_constant_and_returned_value_is_changed_once() -> None:
    assert [mutation.change for mutation in list_mutations(SOURCE)] == [
        "0.5 → 0.75",
        "unit == 'N' and force > self.most → not (unit == 'N' and force > self.most)",
        "unit == 'N' and force > self.most → unit == 'N' or force > self.most",
        "unit == 'N' → unit != 'N'",
        "'N' → 'N!'",
        "force > self.most → force >= self.most",
        "force > self.most → force <= self.most",
        "True → False",
        "return not min(force, 10) < 0 → return True",
        "return not min(force, 10) < 0 → return False",
        "not min(force, 10) < 0 → min(force, 10) < 0",
        "min(force, 10) < 0 → min(force, 10) <= 0",
        "min(force, 10) < 0 → min(force, 10) >= 0",
        "min(force, 10) → max(force, 10)",
        "10 → 11",
        "0 → 1",
        "return 2.0 * -self.most → return 2.0 * -self.most * 1.5",
        "2.0 * -self.most → 2.0 / -self.most",
        "2.0 → 3.0",
        "-self.most → self.most",
    ]


def test_a_mutation_runs_as_the_changed_source_and_equal_ones_of_a_line_are_numbered() -> None:
    first, second = list_mutations("found = [1, 1]\n")
    assert (first.key, second.key) == (("found = [1, 1]", "1 → 2"), ("found = [1, 1]", "1 → 2 (2)"))
    values: list[dict[str, object]] = [{}, {}]
    for mutation, value in zip((first, second), values, strict=True):
        exec(mutation.compiled("found.py"), value)  # noqa: S102
    assert [value["found"] for value in values] == [[2, 1], [1, 2]]


@pytest.mark.parametrize("module", harmless_mutations())
def test_every_harmless_mutation_is_one_of_its_module(module: str) -> None:
    source = (ROOT / f"{module.replace('.', '/')}.py").read_text()
    assert harmless_mutations()[module].keys() <= {mutation.key for mutation in list_mutations(source)}


def test_every_module_has_tests() -> None:
    assert harmless_mutations().keys() <= MODULES.keys()
    assert all(find_tests(module) for module in MODULES)
