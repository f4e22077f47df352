"""The README as a front page; the site builds strictly, fetches nothing, and its reference is that of the code."""

import ast
import re
import sys
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

from docs.reference import pages
from station.cli import VERBS
from station.config import StationConfig, nested_keys
from tests.house.sources import FOLDERS, ROOT, run_python
from tests.station.command import help_of

README = (ROOT / "README.md").read_text(encoding="utf-8")
NAMED = (*FOLDERS, "benchmarks", "docs", "examples", "tests")
LOADED = {"link": "href", "script": "src", "img": "src", "iframe": "src", "source": "src"}


def test_the_front_page_shows_pictures_a_table_and_ten_lines_of_python_before_any_list_of_commands() -> None:
    commands = README.index("\n    station ")
    pictures = re.findall(r"^!\[.+\]\((docs/pictures/[\w-]+\.png)\)", README[:commands], re.M)
    assert sorted(Path(picture).stem.split("-")[0] for picture in pictures) == ["console", "report"]
    assert all((ROOT / picture).is_file() for picture in pictures)
    python = re.findall(r"^```python\n(.*?)^```", README[:commands], re.M | re.S)
    assert [block.count("\n") for block in python] == [10]
    assert "| cuff | k [N/m] |" in README[: README.index("```python")]


def test_the_picture_of_the_layout_is_the_tree() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    picture = page[page.index("\n    station/  ") : page.index("\n`drivers/simulators`")]
    top, drawn = "", set()
    for line in filter(str.strip, picture.splitlines()):
        for place, name in ((match.start(), match[1]) for match in re.finditer(r"(?<![\w/.])([\w-]+)/(?=\s|$)", line)):
            is_top = place == 4 or ((ROOT / name).is_dir() and not (ROOT / top / name).is_dir())
            top = name if place == 4 else top
            drawn.add(name if is_top else f"{top}/{name}")
    folders = {
        path.parent.relative_to(ROOT).as_posix()
        for folder in drawn
        if "/" not in folder
        for path in (ROOT / folder).glob("*/*.py")
    }
    assert {name for name in drawn if not (ROOT / name).is_dir()} == set()
    assert {name for name in folders if not name.startswith("tests/") and "__pycache__" not in name} <= drawn


def test_every_equation_of_the_source_study_is_cited_by_the_function_that_the_table_names() -> None:
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\(\d+\).*?) \|.*`([\w/]+\.py)::([\w.]+)` \|$", page, re.M)
    cited = []
    for equations, file, name in rows:
        node: Any = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        for part in name.split("."):
            node = next(one for one in node.body if getattr(one, "name", "") == part)
        numbers = re.findall(r"\(\d+\)", equations)
        cited += numbers
        assert [number for number in numbers if number not in (ast.get_docstring(node) or "")] == [], name
    assert cited == [f"({number})" for number in range(1, 12)]


def test_files_that_pages_name_exist_and_commands_are_explained() -> None:
    linked = [target for target in re.findall(r"\]\(([^)]+)\)", README) if "://" not in target]
    assert len(linked) > 10 and [target for target in linked if not (ROOT / target).exists()] == []
    explained = (ROOT / "docs" / "commands.md").read_text(encoding="utf-8")
    shown = re.findall(r"^    station (\w+)", README, re.M)
    assert len(shown) == 5 and all(f"\n    station {verb} " in explained for verb in shown)
    pages_read = [*ROOT.glob("*.md"), *(ROOT / "docs").rglob("*.md"), ROOT / "recordings" / "FORMAT.md"]
    named = {
        (page.relative_to(ROOT).as_posix(), path)
        for page in pages_read
        for path in re.findall(rf"`((?:{'|'.join(NAMED)})/[a-z0-9_./-]*)`", page.read_text(encoding="utf-8"))
    }
    assert len(named) > 100
    assert {(page, path) for page, path in named if not (ROOT / path).exists()} == set()


def test_decisions_are_numbered_without_gap_or_double_and_their_titles_repeat_the_number() -> None:
    decisions = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))
    settled = (ROOT / "docs" / "decisions" / "settled.md").read_text(encoding="utf-8")
    lines = re.findall(r"^- (\d{4}(?:, \d{4})*): ", settled, re.M)
    numbers = sorted([page.name[:4] for page in decisions] + [one for line in lines for one in line.split(", ")])
    assert numbers == [f"{number:04d}" for number in range(1, len(numbers) + 1)]
    titles = {page.name: page.read_text(encoding="utf-8").splitlines()[0] for page in decisions}
    assert {name: title for name, title in titles.items() if not title.startswith(f"# {name[:4]} ")} == {}


@pytest.mark.parametrize("verb", VERBS)
def test_the_command_line_page_has_every_option_that_help_has(verb: str) -> None:
    section = re.split(r"^##+ ", pages.command_line(), flags=re.M)
    (mine,) = [part for part in section if part.startswith(f"station {verb}\n")]
    options = set(re.findall(r"(?<![\w-])--[a-z][\w-]+", help_of(verb, 300)))
    shown = set(re.findall(r"`(--[^`]+)`", mine))
    assert {option for option in options if option != "--help" and not option.startswith("--no-")} <= {
        spelling for text in shown for spelling in re.split(r"[,/] ?", text)
    } | {"--help"}


def test_the_configuration_page_has_every_key() -> None:
    page = pages.configuration()
    unnamed = {
        key for key in nested_keys(StationConfig) if f"`{key}`" not in page and not re.search(rf"\[{key}\b", page)
    }
    assert unnamed <= {"simulation"}
    example = (ROOT / "station.toml").read_text(encoding="utf-8")
    tables = set(re.findall(r"^(?:# )?\[(\w+)", example, re.M))
    assert tables == set(re.findall(r"^## \[(\w+)", page, re.M)), "every section of the example"
    assert "| `sample_rate_hz` | number, > 0 | `1000.0` |" in page


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("mkdocs", reason="needs the extra docs: pip install -e '.[docs]'")
    folder = tmp_path_factory.mktemp("site")
    program, quiet = str(Path(sys.executable).with_name("mkdocs")), {"NO_MKDOCS_2_WARNING": "1"}
    ran = run_python("build", "--strict", "--quiet", "--site-dir", folder, program=program, patience_s=200, **quiet)
    assert ran.returncode == 0, ran.stderr
    return folder


@pytest.mark.slow
def test_the_site_has_its_four_parts(site: Path) -> None:
    tutorials = "tutorial/operator tutorial/analyst how-to/driver fitting redundancy decisions glossary"
    reference = "command-line configuration recording-format files"
    for page in (*tutorials.split(), *(f"reference/{name}" for name in reference.split())):
        assert (site / page / "index.html").is_file(), page
    python = (site / "reference" / "python" / "index.html").read_text(encoding="utf-8")
    assert 'id="cuffstation.fit_session"' in python and 'id="cuffstation.CuffFit"' in python
    assert "<li><code>sample_numbers</code>: (n,) uint64</li>" in python, "fields of a docstring are a list"


@pytest.mark.slow
def test_no_page_of_the_site_fetches_anything_from_elsewhere(site: Path) -> None:
    pages_seen = list(site.rglob("*.html"))
    assert len(pages_seen) > 30
    for page in pages_seen:
        reader = _Assets()
        reader.feed(page.read_text(encoding="utf-8"))
        assert not [address for address in reader.found if re.match(r"(https?:)?//", address)], page
    for style in site.rglob("*.css"):
        assert not re.search(r"(@import|url\()\s*[\"']?(https?:)?//", style.read_text(encoding="utf-8")), style


class _Assets(HTMLParser):
    """The addresses that a browser loads by itself; the canonical address of a page is none."""

    def __init__(self) -> None:
        super().__init__()
        self.found: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag in LOADED and given.get("rel") != "canonical":
            self.found.append(given.get(LOADED[tag]) or "")
