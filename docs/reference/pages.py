"""Pages of the site that are written from the code: command line, configuration, recording format, decisions.

A hook of mkdocs (mkdocs.yml). The pages exist in the built site only, so that they cannot differ from the code.
"""

from __future__ import annotations

import inspect
import re
import types
from collections.abc import Callable
from enum import Enum
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Union, get_args, get_origin

from pydantic.fields import FieldInfo
from typer.models import ArgumentInfo

if TYPE_CHECKING:
    from mkdocs.config.defaults import MkDocsConfig
    from mkdocs.structure.files import Files

ROOT = Path(__file__).parents[2]
DECISIONS = ROOT / "docs" / "decisions"
COMMENTED_KEY = re.compile(r"^(?:# )?(\w+) = [^#]*(?:#\s*(.*))?$")
SECTION = re.compile(r"^(?:# )?\[([\w.]+)\]")


def command_line() -> str:
    """Every verb with its arguments, options and the extra it needs."""
    from station.cli import STAGES, app
    from station.extras import EXTRAS_OF_VERB

    page = ["# Command line", "", f"{app.info.help}", ""]
    for place, verbs in STAGES.items():
        page += [f"## {place}", ""]
        for verb in verbs:
            word = verb.__name__.rstrip("_")
            page += [f"### station {word}", "", " ".join((verb.__doc__ or "").split()), ""]
            if word in EXTRAS_OF_VERB:
                page += [f"Needs the extras {', '.join(f'`{extra}`' for extra in EXTRAS_OF_VERB[word])}.", ""]
            parameters = inspect.signature(verb, eval_str=True).parameters.values()
            rows = [_parameter(one) for one in parameters if get_args(one.annotation)]  # not the context
            page += _table(("argument or option", "value", "default", "meaning"), rows)
    page += ["## Exit codes", "", "| code | meaning |", "|---|---|"]
    page += ["| 0 | done |", "| 1 | failed |", "| 2 | wrong usage |"]
    page += ["| 3 | done, but samples, the end of a trial or a frame are missing, or a file has changed |"]
    page += ["| 130 | ended by Ctrl-C |", ""]
    return "\n".join(page)


def configuration() -> str:
    """Every key of station.toml: type and default from the models, meaning from the example's comments."""
    from station.config import StationConfig, section_fields, walk_sections

    example = (ROOT / "station.toml").read_text(encoding="utf-8")
    page = ["# Configuration", ""]
    page += [
        "`station.toml` has these sections and keys; an unknown key is refused. A key without a default is required"
    ]
    page += ["where its section is given.", ""]
    for name, model in walk_sections(StationConfig):
        meanings = _meanings(example, name)
        page += [f"## [{name}]", "", *(_summary(model))]
        rows = [
            (f"`{key}`", _type(field.annotation) + _bounds(field), _default(field), meanings.get(key, ""))
            for key, field in section_fields(model).items()
        ]
        page += _table(("key", "type", "default", "meaning"), rows)
    page += ["## The example", "", "```toml", example.strip(), "```", ""]
    return "\n".join(page)


def recording_format() -> str:
    """recordings/FORMAT.md, as it is."""
    return (ROOT / "recordings" / "FORMAT.md").read_text(encoding="utf-8")


def changelog() -> str:
    return (ROOT / "CHANGELOG.md").read_text(encoding="utf-8").replace("](docs/", "](../")


def decisions() -> str:
    """The list of docs/decisions by the titles of its pages."""
    lines = [f"- [{_title(path)}]({path.name})" for path in sorted(DECISIONS.glob("[0-9]*.md"))]
    first = "Decisions that are still questioned, one page each; the [others](settled.md) have one line each."
    return "\n".join(["# Decisions", "", first, "", *lines, ""])


PAGES: dict[str, Callable[[], str]] = {
    "reference/command-line.md": command_line,
    "reference/configuration.md": configuration,
    "reference/recording-format.md": recording_format,
    "reference/changelog.md": changelog,
    "decisions/index.md": decisions,
}


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Put the decisions into the navigation, and pages of docs/ that mkdocs.yml does not name into its explanations."""
    nav = list(config.nav or [])
    named = set(re.findall(r"[\w/-]+\.md", str(nav)))
    unnamed = [path.name for path in sorted((ROOT / "docs").glob("*.md")) if path.name not in named]
    next(part for part in nav if "Explanation" in part)["Explanation"].extend(unnamed)
    pages = [f"decisions/{path.name}" for path in sorted(DECISIONS.glob("[0-9]*.md"))]
    config.nav = [*nav, {"Decisions": ["decisions/index.md", *pages, "decisions/settled.md"]}]
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the written pages."""
    from mkdocs.structure.files import File

    for place, write in PAGES.items():
        files.append(File.generated(config, place, content=write()))
    return files


def _parameter(parameter: inspect.Parameter) -> tuple[str, str, str, str]:
    kind, info, *_ = get_args(parameter.annotation)
    is_argument = isinstance(info, ArgumentInfo)
    declared = [text for text in (info.default, *(info.param_decls or ())) if isinstance(text, str)]
    spellings = declared or [f"--{parameter.name.rstrip('_').replace('_', '-')}"]
    spelling = parameter.name.upper() if is_argument else ", ".join(spellings)
    value = "flag" if kind is bool else _type(kind).replace('"', "")
    least, most = getattr(info, "min", None), getattr(info, "max", None)
    value += "" if least is None else f", ≥ {least:g}"
    value += "" if most is None else f", ≤ {most:g}"
    default = parameter.default
    if default is inspect.Parameter.empty:
        shown = "required"
    else:
        shown = "" if default in (None, False, (), []) else f"`{default}`"
    return f"`{spelling}`", value, shown, " ".join((info.help or "").replace("|", "\\|").split())


def _table(heads: tuple[str, ...], rows: list[tuple[str, ...]]) -> list[str]:
    if not rows:
        return []
    return [f"| {' | '.join(heads)} |", "|---" * len(heads) + "|", *(f"| {' | '.join(row)} |" for row in rows), ""]


def _meanings(example: str, section: str) -> dict[str, str]:
    """Key → the comment behind it in the example's section."""
    found: dict[str, str] = {}
    is_named, inside = section.endswith(".NAME"), False
    for line in example.splitlines():
        if head := SECTION.match(line):
            inside = head[1] == section or (is_named and head[1].startswith(section.removesuffix("NAME")))
        elif inside and (key := COMMENTED_KEY.match(line)) and key[2]:
            found.setdefault(key[1], key[2].replace("|", "\\|"))
    return found


def _summary(model: type[Any]) -> list[str]:
    own = model.__dict__.get("__doc__")
    return [own.split("\n\n")[0].replace("\n", " "), ""] if own else []


def _type(annotation: Any) -> str:
    if annotation is None or annotation is type(None):
        return "absent"
    if get_origin(annotation) is Literal:
        return " \\| ".join(
            f'`"{option}"`' if isinstance(option, str) else f"`{option}`" for option in get_args(annotation)
        )
    if get_origin(annotation) in (Union, types.UnionType):
        return " or ".join(_type(option) for option in get_args(annotation) if option is not type(None))
    if get_origin(annotation) in (tuple, list):
        return f"list of {_type(get_args(annotation)[0])}"
    if hasattr(annotation, "__metadata__"):  # Annotated
        return _type(get_args(annotation)[0])
    names = {float: "number", int: "whole number", str: "text", Path: "path", bool: "true or false", dict: "section"}
    is_enum = isinstance(annotation, type) and issubclass(annotation, Enum)
    return "" if is_enum else names.get(annotation, getattr(annotation, "__name__", str(annotation)))


def _bounds(field: FieldInfo) -> str:
    signs = {"gt": ">", "ge": "≥", "lt": "<", "le": "≤"}
    limits = [
        f"{sign} {getattr(limit, name):g}"
        for limit in field.metadata
        for name, sign in signs.items()
        if hasattr(limit, name)
    ]
    return ", " + ", ".join(limits) if limits else ""


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "required"
    default = field.get_default(call_default_factory=True)
    if default is None or default in ((), {}):
        return "none"
    return f"`{str(default).lower() if isinstance(default, bool) else default}`"


def _title(path: Path) -> str:
    heading = next(line for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("# "))
    return heading.removeprefix("# ")
