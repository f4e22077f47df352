"""Source distribution and wheel: the same bytes from the same content, with examples, tests and the sample session."""

import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import sysconfig
import tarfile
import zipfile
from pathlib import Path

import pytest

from station.files.init import InitError, write_examples
from station.messages.setup_messages import ConfigCode
from tests.house.sources import FOLDERS, ROOT, run_python
from tests.refusals import raises_refusal
from tests.solver.test_compile_ahead import CUFFS
from tests.solver.test_kernel_wheel import has_instructions
from tests.timeout import scaled_timeout

BUILD = "import sys; from setuptools import build_meta as b; to = sys.argv[1]; b.build_sdist(to); b.build_wheel(to)"
MOST_BEYOND_WARM_S = 1.5  # without the imports of the fit before it
FIRST_USE = """
import sys, time
from pathlib import Path
import cuffstation as cs
import solver
assert Path(solver.__file__).is_relative_to(sys.prefix), solver.__file__
model = cs.load_model()
times = []
for _ in range(2):
    began = time.process_time()
    cs.assess(cs.read_cuffs("cuffs.json"), model, cs.load_motion(model, every=200), people=0)
    times.append(time.process_time() - began)
print("first use:", times[0] - times[1])
"""


def copied_checkout(folder: Path) -> Path:
    """The files that git knows, as old and as readable as the copy."""
    listing = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(listing, cwd=ROOT, capture_output=True, text=True, check=True)  # noqa: S603
    for name in filter(None, listed.stdout.splitlines()):
        if (ROOT / name).is_file():  # not deleted in the working tree
            (folder / "tree" / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / "tree" / name).write_bytes((ROOT / name).read_bytes())
    return folder / "tree"


def build(tree: Path, code: str, folder: Path) -> None:
    """Run code of the build system in the tree; its argument is the folder of what it builds."""
    subprocess.run(  # noqa: S603
        [sys.executable, "-c", code, str(folder)],
        cwd=tree,
        env={**os.environ, "SOURCE_DATE_EPOCH": "1764115200"},
        capture_output=True,
        timeout=scaled_timeout(200),
        check=True,
    )


def distributions(folder: Path) -> dict[str, Path]:
    """Suffix → sdist and wheel of a copy of the checkout."""
    build(copied_checkout(folder), BUILD, folder)
    return {path.suffix: path for path in (*folder.glob("*.tar.gz"), *folder.glob("*.whl"))}


@pytest.mark.slow
def test_two_builds_have_the_same_bytes_and_hold_what_a_user_needs(tmp_path: Path) -> None:
    first, second = (distributions(tmp_path / name) for name in ("first", "second"))
    assert [hashlib.sha256(path.read_bytes()).digest() for path in first.values()] == [
        hashlib.sha256(path.read_bytes()).digest() for path in second.values()
    ]
    with tarfile.open(first[".gz"]) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    assert {"tests/conftest.py", "examples/leg/leg.osim", "station/sample_session/test-bounce_run-1.mcap"} <= names
    assert {"docs/quick-start.md", "mkdocs.yml"} <= names  # tests read them
    with zipfile.ZipFile(first[".whl"]) as wheel:
        shared = {name.partition("share/cuffstation/")[2] for name in wheel.namelist()}
        assert {"station.toml", "examples/fit_a_cuff.py", "examples/leg/leg.osim"} <= shared
        assert "station/sample_session/test-bounce_run-1.mcap" in wheel.namelist()
        tree = tmp_path / "first" / "tree"
        known = {path.relative_to(tree).as_posix() for folder in FOLDERS for path in (tree / folder).rglob("*.*")}
        assert known == {name for name in wheel.namelist() if name.partition("/")[0] in FOLDERS}
        assert all(wheel.read(name) == (tree / name).read_bytes() for name in known)
    target = str(tmp_path / "installed")
    run_python("-m", "pip", "install", "--no-deps", "--no-index", "-q", "--target", target, first[".whl"])
    use = "import cuffstation as cs; print(cs.__file__, sorted(path.name for path in cs.sample_session().iterdir()))"
    ran = run_python("-c", use, folder=tmp_path, PYTHONPATH=target)
    assert ran.stdout.startswith(target) and "test-bounce_run-1.mcap" in ran.stdout, ran.stderr


@pytest.mark.slow
def test_an_editable_install_is_a_path_that_type_checkers_follow(tmp_path: Path) -> None:
    tree = copied_checkout(tmp_path)
    build(tree, "import sys; from setuptools import build_meta as b; b.build_editable(sys.argv[1])", tmp_path)
    (wheel,) = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as installed:
        (path,) = (name for name in installed.namelist() if name.startswith("__editable__"))
        assert path.endswith(".pth") and Path(installed.read(path).decode().strip()) == tree


@pytest.mark.slow
@pytest.mark.timeout(900)
@pytest.mark.skipif(sys.platform == "win32", reason="the page has bin/ in its lines, Windows Scripts/")
@has_instructions
def test_the_quick_start_runs_line_by_line_from_a_wheel_with_kernels_and_compiles_nothing(tmp_path: Path) -> None:
    """Dependencies and pip are those of this environment, which the new one sees behind its own packages."""
    kept = tmp_path / "kept"
    environment = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment |= {"MPLBACKEND": "agg"}
    programs = {"python": [sys.executable]}
    programs["cuffs/bin/pip"] = [*programs["python"], "-m", "pip", "--python", str(tmp_path / "cuffs")]

    def run(command: str, *words: str, code: str = "", folder: Path = tmp_path) -> str:
        ran = subprocess.run(  # noqa: S603
            [*programs.get(command, [str(tmp_path / command)]), *words],
            cwd=folder,
            input=code,
            env=environment,
            capture_output=True,
            text=True,
            timeout=scaled_timeout(300),
            check=False,
        )
        assert ran.returncode == 0, ran.stderr
        return ran.stdout

    run("python", "-m", "solver.kernel_wheel", str(tmp_path), folder=ROOT)  # with what is compiled in this checkout
    environment["NUMBA_CACHE_DIR"] = str(kept)
    (wheel,) = tmp_path.glob("*.whl")
    assert f"-cp{sys.version_info.major}{sys.version_info.minor}-none-" in wheel.name
    page = (ROOT / "docs" / "quick-start.md").read_text(encoding="utf-8")
    page = page.replace("cuffstation-0.2.0-py3-none-any.whl", wheel.name)
    lines = [shlex.split(line, comments=True) for line in re.findall(r"^    (\S.*)$", page, re.M)]
    fit, *others = re.findall(r"^```python\n(.*?)^```", page, re.M | re.S)
    code = "\n".join([fit, FIRST_USE, *others])
    assert [line[0] for line in lines] == ["python", "cuffs/bin/pip", "cuffs/bin/station", "cuffs/bin/python"]
    (tmp_path / "cuffs.json").write_text(json.dumps({"cuffs": CUFFS}), encoding="utf-8")
    printed = ""
    for command, *words in lines:
        offline = ["--no-deps", "--no-index"] if command.endswith("pip") else []
        without_pip = ["--without-pip"] if "venv" in words else []
        printed = run(command, *words, *offline, *without_pip, code=code)
        for packages in (tmp_path / "cuffs").glob("lib/python*/site-packages"):
            (packages / "dependencies.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")
    assert "8515 +/- 30 N/m (0.36 %), 95 %: 8301 to 8741" in printed and "visco_elastic" in printed
    assert (tmp_path / "effort.png").is_file() and (tmp_path / "study" / "station.toml").is_file()
    assert not list((tmp_path / "study").rglob("*.pyc")), "pip compiles the examples"
    assert list(tmp_path.glob("cuffs/lib/python*/site-packages/cuffstation/__init__.py"))
    assert float(re.findall(r"first use: (.*)", printed)[0]) < MOST_BEYOND_WARM_S
    run("cuffs/bin/station", "rmr", "--every", "100", "--output", str(tmp_path / "rmr.csv"))
    assert not [path for path in kept.rglob("*") if path.is_file()], "what was compiled"


def test_the_configuration_and_the_examples_are_written_and_no_file_is_replaced(tmp_path: Path) -> None:
    assert write_examples(tmp_path) == [tmp_path / "station.toml", tmp_path / "examples"]
    assert (tmp_path / "station.toml").read_bytes() == (ROOT / "station.toml").read_bytes()
    written = {path.relative_to(tmp_path / "examples") for path in (tmp_path / "examples").rglob("*.*")}
    assert {Path("fit_a_cuff.py"), Path("leg/stride.mot")} <= written
    (tmp_path / "station.toml").write_text("mine", encoding="utf-8")
    with raises_refusal(ConfigCode.EXISTS, kind=InitError):
        write_examples(tmp_path)
    assert (tmp_path / "station.toml").read_text(encoding="utf-8") == "mine"
