"""A project of somebody else, in an environment that has the wheel and what it asks for: `project/`.

Its types are checked, by mypy and by pyright; it runs; its own tests pass.
"""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from kit.process import PATIENCE
from kit.wheel import build, environment

#: Runs the environment's Python in the folder of the project.
Run = Callable[..., subprocess.CompletedProcess[str]]

CHECKERS = {
    "mypy": ("mypy", "--python-executable"),
    "pyright": ("basedpyright", "--warnings", "--pythonpath"),
}
#: One in each line: names that do not exist, arguments and results that do not fit, an override of another kind.
MISTAKES = """\
from gateway import Gatewey
import gateway; gateway.Nothing
from gateway import Area, CustomUnit, UnitClient, events
events.NoEvent
async def read(unit: UnitClient) -> list[int]: return await unit.read_holding("a")
async def show(unit: UnitClient) -> str: return await unit.read_holding(0)
class Wrong(CustomUnit):
    async def read(self, area: Area, address: int) -> list[int]: return [0]
"""
WRONG_LINES = {1, 2, 4, 5, 6, 8}


@pytest.fixture(scope="module")
def python(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("stranger")
    build(folder)
    (wheel,) = folder.glob("*.whl")
    return environment(folder / "venv", wheel, "pytest", "pytest-asyncio")


@pytest.fixture
def project(tmp_path: Path) -> Path:
    return Path(shutil.copytree(Path(__file__).with_name("project"), tmp_path / "project"))


@pytest.fixture
def run(python: Path, project: Path) -> Run:
    def run(*words: str) -> subprocess.CompletedProcess[str]:
        clean = {"PATH": os.defpath, "HOME": str(project)}
        whole = [python, *words]
        return subprocess.run(
            whole, capture_output=True, text=True, check=False, timeout=PATIENCE, cwd=project, env=clean
        )

    return run


def printed(done: subprocess.CompletedProcess[str]) -> str:
    """What it printed; it went well."""
    assert (done.returncode, done.stderr) == (0, ""), done.stdout + done.stderr
    return done.stdout


def test_nothing_of_the_checkout_is_there(run: Run, python: Path) -> None:
    assert printed(run("-c", "import gateway; print(gateway.__file__)")).startswith(str(python.parents[1]))
    printed(run("-c", "import importlib.util as it; assert not it.find_spec('kit') and not it.find_spec('aiohttp')"))


@pytest.mark.parametrize("checker", CHECKERS)
def test_its_types_are_right_and_mistakes_are_seen(checker: str, python: Path, project: Path) -> None:
    (project / "mistakes.py").write_text(MISTAKES)
    command, *words = CHECKERS[checker]
    pytest.importorskip(command, reason="not on this kind of machine")
    whole = [Path(sys.executable).with_name(command), *words, python, "."]
    done = subprocess.run(whole, capture_output=True, text=True, check=False, timeout=PATIENCE, cwd=project)
    told = re.findall(r"^.*?(\w+\.py):(\d+)(?=:.*(?:error|warning):)", done.stdout, re.MULTILINE)
    assert {(file, int(line)) for file, line in told} == {("mistakes.py", line) for line in WRONG_LINES}, done.stdout


def test_it_runs(run: Run) -> None:
    assert printed(run("-W", "error", "plant.py", "plant.toml")).splitlines() == [
        "weight 950",
        "refused with 2",
        "tcp [950, 1] [] 0",
        "[200, 60]",
    ]


def test_the_daemon_accepts_its_config_too(run: Run) -> None:
    told = printed(run("-m", "gateway", "check", "plant.toml"))
    assert "silo:Silo" in told
    assert told.endswith("no errors, no warnings\n")


def test_what_is_wrong_with_its_config_is_said_without_a_traceback(run: Run, project: Path) -> None:
    (project / "wrong.toml").write_text("[[image]]\nunit = 600\n")
    done = run("plant.py", "wrong.toml")
    assert (done.returncode, done.stdout) == (1, "")
    assert done.stderr.startswith("wrong.toml:2:8: ")
    assert "600" in done.stderr
    assert "Traceback" not in done.stderr


def test_its_tests_pass(run: Run) -> None:
    assert " passed" in printed(run("-m", "pytest", "-q", "-p", "no:cacheprovider"))
