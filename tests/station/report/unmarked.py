"""Numbers that a page shows and does not list in report.json. It strips the page by itself, without the station."""

from __future__ import annotations

import json
import re
from html import unescape
from pathlib import Path

MARKED = re.compile(r'<(data|span) class="number" id="([^"]+)".*?</\1>', re.DOTALL)
TRIALS = re.compile(r'<(td|span) class="trial">.*?</\1>', re.DOTALL)
"""Number, time and title of a recording."""
FIGURES = re.compile(r'<figure[^>]*><div id="([^"]+)">.*?</figure>', re.DOTALL)
REASONED = {
    r"\b95 % (prediction )?(intervals?|cone|CI)\b": "level of all intervals",
    r"\(0\)|\(1\)|\bat lag 0\b|\bbelow 1 the suit\b|\b90 % of the best saving\b": "definitions",
    r"\b5 % of$": "what a 95 % interval leaves",
    r"\bSHA-256\b|\bC3D\b": "names of standards",
    r"\(2019\), Front\. Neurorobot\. 13:90|\(2023\), PLoS ONE 18\(11\):e0295003, CC BY 4\.0": "literature",
    r"\bhigh-pass 100 Hz, rectified, low-pass 2\.5 Hz \(Seth et al\. 2019\)|\bmore than 10 ms\b": "a published method",
    r"\b\d{4}-\d\d-\d\d\b|\b\d\d:\d\d\b": "dates and times",
    r"\bcuffstation \d+\.\d+\.\d+\S*": "version of the station",
    r"← [\w-]+, \w+ [\d.]+: given by hand|\b\w+ [\d.]+ (N/m|N s/m|m) is given by hand": (
        "a link of the chain, whose number is in the table of cuffs, too"
    ),
    r"\b\d+ links checked, \d+ not as recorded": "state of the folder, which `station verify` finds again",
    r"\bscaled to the wearer by \d+ trials": "name of the model",
}
"""What is no result: pattern → reason."""


def unmarked_numbers(page: Path, *names: str) -> list[str]:
    """Lines of the page with a digit outside of marked numbers, figures, file names and what is reasoned above.

    names: of devices, subjects and folders, which may have digits.
    """
    listed = json.loads(page.with_name("report.json").read_text(encoding="utf-8"))
    text = page.read_text(encoding="utf-8")
    body = text[text.index("<body") :]
    assert [found[2] for found in MARKED.finditer(body)] == list(listed["numbers"])
    assert {found[1] for found in FIGURES.finditer(body)} == set(listed["figures"])
    body = TRIALS.sub("", FIGURES.sub("", MARKED.sub("", body)))
    body = re.sub(r"<(script|code|h1|h3)\b.*?</\1>", "", body, flags=re.DOTALL)
    plain = unescape(re.sub(r"<[^>]*>", "\n", body)).replace("\u00a0", " ")
    for name in (*listed["inputs"], *names):
        plain = plain.replace(name, "")
    for pattern in REASONED:
        plain = re.sub(pattern, "", plain, flags=re.MULTILINE)
    return [line.strip() for line in plain.splitlines() if re.search(r"\d", line)]
