"""A session as it was recorded, fitted, assessed with a short motion and few people, and reported.

Numbers that its page shows and does not list in report.json are found without the station.
"""

import json
import re
from html import unescape
from pathlib import Path

from station.assessment.budget_file import read_budget
from station.assessment.people_run import PeopleRun, SourceChoice
from station.checksums import write_checksums
from tests.station.foreign import static_and_dynamic

STATIC, DYNAMIC = (f"cuff-hand_test-{test}_run-1.mcap" for test in ("static", "dynamic"))
MARKED = re.compile(r'<(data|span) class="number" id="([^"]+)".*?</\1>', re.DOTALL)
TRIALS = re.compile(r'<(td|span) class="trial"[^>]*>.*?</\1>', re.DOTALL)
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
    r"\b\d+ links? checked, \d+ not as recorded": "state of the folder, which `station verify` finds again",
    r"\bscaled to the wearer by \d+ trials?": "name of the model",
}
"""What is no result: pattern → reason."""


def report_session(folder: Path, people: int = 0) -> Path:
    """Two trials of one cuff from an independent experiment, with their results, in a new folder `session` below."""
    from station.assessment.assess import assess_cuffs, write_assessment
    from station.assessment.assessment_inputs import AssessmentInputs
    from station.fit import fit_session_folder
    from station.report.page import write_report

    folder /= "session"
    folder.mkdir(parents=True)
    for truth, file in zip(static_and_dynamic(), (STATIC, DYNAMIC), strict=True):
        truth.record(folder / file)
    true = {"hand": {"stiffness_n_per_m": 4000.0, "damping_n_s_per_m": 100.0, "migration_m": 0.01}}
    (folder / "simulated_truth.json").write_text(json.dumps(true))
    write_checksums(folder / STATIC, folder / DYNAMIC)  # as the recorder does when a trial ends
    fitted = fit_session_folder(folder, folder / "cuffs.json")
    inputs = AssessmentInputs(folder / "cuffs.json")
    worn = {name: fit.wearable() for name, fit in fitted.cuffs.items()}
    run = few_people(people) if people else None
    write_assessment(assess_cuffs(worn, inputs, most_frames=4, most_rest_lengths=5, people=run), folder)
    write_report(folder, fitted)
    return folder


def few_people(count: int, frames: int = 4, sources: SourceChoice = "all") -> PeopleRun:
    """A run with the bundled sources and so many people, each in about so many frames."""
    budget = read_budget()
    sample = budget.sample.model_copy(update={"people": count, "frames": frames})
    return PeopleRun(budget.model_copy(update={"sample": sample}), sources=sources)


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
