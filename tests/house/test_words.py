"""One name for one thing: no public class twice, no replaced name or phrase, one line for a term of the glossary."""

import ast
import io
import re
import tokenize
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest

from tests.house.sources import FOLDERS, ROOT, SOURCES, name_of, text_of

PAGES = [
    path
    for path in (*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), *(ROOT / "recordings").rglob("*.md"))
    if path.name != "CHANGELOG.md"
]

GIVEN_UP = """
Announcer → AudioAlerts; Conversation → QtmConnection; Daemon → TrialRecorder; Doorkeeper → AccessMiddleware;
Hearing → StreamWatchdog; Reach → ArrivalClock; ReducedTrial → Pull; Room → Workspace; Sureness → UncertaintySummary;
Thinning → Decimator; TrialCurves → FittedPull; TrialSession → states of a trial; TurnedBack → LagPosterior;
Wearing → SuitScenario; Wishes → QtmSettings; WornMotion → SuitedMotion; faithful → opensim; fan_room → allocate_fan;
feigned → apparent_damping; follow_chain → evaluate_chain; go_through → evaluate_motion;
lay_all → evaluate_wrapped_paths; lay_path → wrap_path; left_over → residual_rms; read_source → read_regular;
refuted_by → with_diagnosis; room_for → allocate; stairs → piecewise_constant; sum_up → summarise;
weigh → mass_matrix_and_bias
"""
"""Replaced name → the field's term."""
PHRASES = ("nothing speaks against", "talk to stderr", "stderr talk", "a session, or one to go on with")
PAGE_PHRASES = """
all the same → still; are told → are reported; be believed → be used; brought back → reconnected;
called identified → identified; cannot be told → cannot be distinguished; cuff's way → cuff displacement;
goes on with → continues; held against → compared with; in mid trial → during a trial; is told → is reported;
likewise → the same; no more than → at most; nobody → no client, no person; none of ours → not a cuffstation recording;
relied on → identified; rubs → has friction; says nothing → does not determine;
so many seconds → for duration_s seconds; somebody → a person, another program; speaks against → no findings;
stands beside → is beside; tells nothing → does not determine; what is not known of → uncertainty of;
what the law leaves → residual
"""
"""Phrase that no page of the documentation may have → the replacement."""

EMPTY_NOUNS = frozenset({"each", "words", "said", "way", "ways"})
"""Names that do not describe a value."""
ROWS = [
    [cell.strip() for cell in line.strip().strip("|").split("|")]
    for line in (ROOT / "docs" / "glossary.md").read_text(encoding="utf-8").splitlines()
    if line.startswith("| ") and not line.startswith("| term")
]


def _replacements(pairs: str) -> dict[str, str]:
    return dict(pair.strip().split(" → ") for pair in pairs.split(";"))


def _names(path: Path, wanted: frozenset[str]) -> set[str]:
    """The wanted names that a source has outside its texts and comments; without such a word it is not tokenized."""
    if not wanted.intersection(_words(path)):
        return set()
    tokens = tokenize.generate_tokens(io.StringIO(text_of(path)).readline)
    return {token.string for token in tokens if token.type == tokenize.NAME and token.string in wanted}


@cache
def _words(path: Path) -> frozenset[str]:
    return frozenset(re.findall(r"\w+", text_of(path)))


@cache
def _lower(path: Path) -> str:
    return " ".join(text_of(path).lower().split())


def test_no_public_class_is_named_twice() -> None:
    homes = defaultdict(list)
    for path in SOURCES:
        for name in re.findall(r"^ *class ([A-Za-z]\w*)[(:]", text_of(path), re.M):
            homes[name].append(name_of(path))
    assert {name: places for name, places in homes.items() if len(places) > 1} == {}


@pytest.mark.parametrize(("old", "new"), _replacements(GIVEN_UP).items())
def test_a_name_that_was_replaced_is_in_no_source_and_on_no_page(old: str, new: str) -> None:
    sources = [path for path in SOURCES if old in _words(path)]
    found = {name_of(path) for path in sources if _names(path, frozenset({old})) or _is_a_value(old, path)}
    pages = {name_of(path) for path in PAGES if re.search(rf"`[^`\n]*\b{old}\b[^`\n]*`", text_of(path))}
    assert found | pages == set(), new


@pytest.mark.parametrize("phrase", PHRASES)
def test_a_phrase_that_was_replaced_is_in_no_source_and_on_no_page(phrase: str) -> None:
    assert [name_of(path) for path in (*SOURCES, *PAGES) if phrase in _lower(path)] == []


@pytest.mark.parametrize(("phrase", "new"), _replacements(PAGE_PHRASES).items())
def test_a_page_has_no_phrase_that_was_replaced(phrase: str, new: str) -> None:
    found = [name_of(path) for path in PAGES if re.search(rf"\b{phrase}\b", _lower(path))]
    assert found == [], new


@pytest.mark.parametrize("folder", FOLDERS)
def test_no_value_is_named_by_an_empty_noun(folder: str) -> None:
    sources = (path for path in SOURCES if path.relative_to(ROOT).parts[0] == folder)
    empty = {name_of(path): sorted(_names(path, EMPTY_NOUNS)) for path in sources}
    assert {file: names for file, names in empty.items() if names} == {}


def test_no_function_is_named_plain_or_of_in_place_of_a_verb_or_its_result() -> None:
    named = re.compile(r"^ *(?:async )?def (_?plain_\w+|\w+_of)\(", re.M)
    assert {name_of(path): names for path in SOURCES if (names := named.findall(text_of(path)))} == {}


def test_no_definition_is_a_relative_clause() -> None:
    """A docstring begins with the noun of what it defines, or the verb of what it does."""
    clause = re.compile(r'^ *(?:r?""")(?:What|Who|Whatever)\b.*', re.M)
    assert {name_of(path): texts for path in SOURCES if (texts := clause.findall(text_of(path)))} == {}


def _is_a_value(old: str, path: Path) -> bool:
    return re.search(rf"[\"']{old}[\"']", text_of(path)) is not None


def test_there_are_at_least_forty_terms_and_none_twice() -> None:
    terms = [row[0] for row in ROWS]
    assert len(terms) >= 40
    assert len(set(terms)) == len(terms)


@pytest.mark.parametrize("row", ROWS, ids=lambda row: row[0])
def test_the_place_of_a_term_exists(row: list[str]) -> None:
    _term, meaning, place = row
    assert meaning
    named = re.fullmatch(r"`([\w/]+\.py)(?:::(\w+)(?:\.(\w+))?)?`", place)
    assert named is not None, place
    path, name, member = named.groups()
    scope = ast.parse((ROOT / path).read_text(encoding="utf-8")).body
    for wanted in filter(None, (name, member)):
        found = [node for node in scope if wanted in _names_of(node)]
        assert found, f"{path} defines no {wanted}"
        scope = getattr(found[0], "body", [])


def _names_of(node: ast.stmt) -> set[str]:
    if isinstance(node, ast.ClassDef | ast.FunctionDef):
        return {node.name}
    targets = node.targets if isinstance(node, ast.Assign) else [node.target] if isinstance(node, ast.AnnAssign) else []
    return {target.id for target in targets if isinstance(target, ast.Name)}
