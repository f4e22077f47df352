"""The scripts in examples/: they run as scripts and as notebooks, unedited and without arguments, and have types."""

import re
import runpy
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from tests.house.sources import ROOT, run_python
from tests.timeout import scaled_timeout

SCRIPTS = sorted((ROOT / "examples").glob("*.py"))
USER_SCRIPT = """
import matplotlib.pyplot as plt
import pandas as pd

import cuffstation as cs

fit = cs.fit_session(cs.sample_session(), window={"cuff-hand_test-static_run-1.mcap": (0.0, 20.0)})
error: float = fit.cuffs["hand"].covariance_dataframe().to_numpy()[0, 0]
table = pd.DataFrame({"name": ["hand"], "stiffness": [8520], "damping": [210], "migration": [0.012]})
for cuffs in (fit, fit.cuffs, table, table.iloc[0], "cuffs.json", cs.published_cuffs(), [cs.Cuff("hand", stiffness=1)]):
    assessment: cs.Assessment = cs.assess(cuffs, rest_lengths=[0.7, 0.75], people=0)
figure, axes = plt.subplots()
same = cs.plot(assessment, ax=axes).get_xlabel()
png: bytes = cs.plot(fit)._repr_png_()
cost = cs.ActivationCost(lambda a: a**4, lambda a: 4 * a**3, lambda a: 12 * a**2)
options = cs.RedundancyOptions(cost=cost)
"""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Sample sessions are kept in a folder of the test, not in the cache of the user who runs it; a notebook's kernel
    chooses how it shows pictures."""
    monkeypatch.delenv("MPLBACKEND", raising=False)
    monkeypatch.setenv("LOCALAPPDATA" if sys.platform == "win32" else "XDG_CACHE_HOME", str(tmp_path / "cache"))


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_the_example_runs_and_is_short(path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert len(path.read_text(encoding="utf-8").splitlines()) < 60
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "argv", [str(path)])
    runpy.run_path(str(path), run_name="__main__")


@pytest.mark.slow
def test_the_notebook_of_forty_tasks_keeps_its_results_and_the_examples_run_as_notebooks(tmp_path: Path) -> None:
    """In one kernel, since most of the time of a notebook is that of imports: the tasks first, then every example."""
    nbclient = pytest.importorskip("nbclient", reason="needs the extra test")
    import nbformat
    from nbformat.v4 import new_code_cell

    path = ROOT / "examples" / "forty_tasks.ipynb"
    kept = [cell for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]
    assert len(kept) == 41, "imports, and a cell for each task"
    shutil.copytree(ROOT / "examples", tmp_path / "examples")
    cells_of = {
        path.stem: [
            new_code_cell(cell.split("# %% [markdown]")[0])
            for cell in path.read_text(encoding="utf-8").split("# %%\n")[1:]
        ]
        for path in SCRIPTS
    }
    notebook = nbformat.read(path, 4)
    run = [cell for cell in notebook.cells if cell.cell_type == "code"]
    notebook.cells += [cell for cells in cells_of.values() for cell in cells]
    client = nbclient.NotebookClient(notebook, timeout=int(scaled_timeout(120)), kernel_name="python3")
    client.execute(cwd=str(tmp_path / "examples"))
    for old, new in zip(kept, run, strict=True):
        assert _kinds(old.outputs) == _kinds(new.outputs), new.source
    for name, cells in cells_of.items():
        assert {"image/png"} <= set().union(*_kinds(cells[-1].outputs)), name


def _kinds(outputs: list[Any]) -> list[set[str]]:
    return [set(output.get("data", {})) for output in outputs]


@pytest.mark.slow
@pytest.mark.parametrize("page", ["gallery.md", "tutorial/analyst.md"])
def test_the_code_of_a_page_draws_its_pictures(page: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    names: dict[str, object] = {}
    for block in re.findall(r"^```python\n(.*?)^```", text, re.M | re.S):
        exec(block, names)  # noqa: S102
    for picture in re.findall(r"pictures/(gallery-[\w-]+\.png)", text):
        assert (tmp_path / picture).is_file() and (ROOT / "docs" / "pictures" / picture).is_file()


@pytest.mark.slow
def test_the_examples_and_a_script_of_a_user_pass_a_strict_check_of_types(tmp_path: Path) -> None:
    script = tmp_path / "of_a_user.py"
    script.write_text(USER_SCRIPT, encoding="utf-8")
    ran = run_python("-m", "mypy", "--strict", *SCRIPTS, script, MYPYPATH=str(ROOT))
    assert ran.returncode == 0, ran.stdout
