"""The tests in virtual time on every Python: with the newest libraries, compiled, and with the oldest libraries.

    .venv/bin/python tests/soak/pythons.py
    .venv/bin/python tests/soak/pythons.py 3.13 3.14t /opt/python/bin/python3.14 --with compiled

A Python is one that uv finds or brings, or that a release of Debian has; one that cannot be had is named at the end. It
needs uv and a C compiler, makes its environments in a folder of its own, and takes half an hour on two cores. Then it
looks whether the pinned libraries can be had for musl, where it runs nothing. Status 0 if all that ran has passed.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Final, NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "deploy"))

from kit.debian_python import debian_python, why_not
from releasing.commands import python_here
from releasing.kinds import PYTHONS
from soak.lowest import TESTS, lowest

CHECKOUT: Final = Path(__file__).resolve().parents[2]
#: Each test that runs in virtual time; those that try many cases run once, elsewhere.
PURE: Final = ("tests", "--ignore", "tests/system", "-m", "not search")
#: What the compiled modules take part in, as in deploy/go.
COMPILED: Final = (
    *(f"tests/{name}" for name in ("devices", "images", "lines", "listeners", "modbus", "model", "ports", "registers")),
    *(f"tests/{name}" for name in ("routing", "service", "stories", "timing", "trace", "upstreams")),
    *("-o", "pythonpath=tests deploy"),
    *("-m", "not search and not interpreted"),
)
#: Runs the pure wheel; no wheel is compiled for it yet.
NEXT: Final = "3.15"
PLATFORMS: Final = ("x86_64-unknown-linux-musl", "aarch64-unknown-linux-musl")


class CommandFailed(Exception):  # noqa: N818 - what happened
    """A command before the tests has failed; the text says which."""


class Outcome(NamedTuple):
    """What came of one run: the last line of pytest, or what failed before it."""

    python: str
    libraries: str
    text: str
    passed: bool
    seconds: float


def project() -> dict[str, object]:
    """What pyproject.toml declares."""
    return tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def declared() -> list[str]:
    """Every library of the gateway, as pyproject.toml asks for it."""
    own = project()
    return [*own["dependencies"], *(each for texts in own["optional-dependencies"].values() for each in texts)]


def find(wanted: str) -> str:
    """The interpreter for a version or a path; empty if there is none."""
    if "/" in wanted:
        return wanted
    return python_here(wanted) or next(map(str, _of_pyenv(wanted)), "") or _of_debian(wanted)


def _of_pyenv(version: str) -> list[Path]:
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    return sorted(root.glob(f"versions/{version}.*/bin/python{version}"), reverse=True)


def _of_debian(version: str) -> str:
    return "" if why_not(version) else str(debian_python(version))


class Environment:
    """A fresh environment of one Python, with what tests and compiles."""

    def __init__(self, python: str, folder: Path) -> None:
        self.python = folder / "bin/python"
        self._run("uv", "venv", "--quiet", "--python", python, folder)
        self._pip("--requirement", CHECKOUT / "deploy/requirements-dev.txt")

    def take_newest(self) -> None:
        """Install the newest libraries that pyproject.toml allows."""
        self._pip("--only-binary", ":all:", "--upgrade", *declared())

    def take_lowest(self) -> None:
        """Install the oldest ones."""
        self._pip("--only-binary", ":all:", *map(lowest, declared()))

    def compile(self) -> None:
        """Install the gateway, and compile it there."""
        (site,) = self.python.parents[1].glob("lib/python3*/site-packages")
        shutil.copytree(CHECKOUT / "gateway", site / "gateway", ignore=shutil.ignore_patterns("__pycache__"))
        self._run(self.python, CHECKOUT / "deploy/compile", site)
        self._run(self.python, "-P", "-c", "import gateway.lines.line as it; assert it.__file__.endswith('.so')")

    def test(self, *words: str) -> tuple[str, bool]:
        """The last line of pytest, and whether all has passed."""
        command = [self.python, "-m", "pytest", "--quiet", "-p", "no:cacheprovider", "--numprocesses", "auto", *words]
        with subprocess.Popen(command, cwd=CHECKOUT, stdout=subprocess.PIPE, text=True) as running:
            last = ""
            for line in running.stdout:
                if not re.match(r"[.sx]+ +\[", line):
                    print(line, end="", flush=True)
                last = line.strip() or last
        return last, running.returncode == 0

    def _pip(self, *words: str | Path) -> None:
        self._run("uv", "pip", "install", "--quiet", "--python", self.python, *words)

    def _run(self, *words: str | Path) -> None:
        done = subprocess.run(words, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
        if done.returncode:
            print(done.stdout)
            raise CommandFailed(f"{Path(words[0]).name} {words[1]} has failed")


def newest(environment: Environment) -> tuple[str, bool]:
    """Everything, with the newest libraries."""
    environment.take_newest()
    return environment.test(*PURE)


def compiled(environment: Environment) -> tuple[str, bool]:
    """The same with compiled modules, as far as they take part."""
    environment.take_newest()
    environment.compile()
    return environment.test(*COMPILED)


def oldest(environment: Environment) -> tuple[str, bool]:
    """What imports a library, with the oldest ones."""
    environment.take_lowest()
    return environment.test(*TESTS)


RUNS: Final[dict[str, Callable[[Environment], tuple[str, bool]]]] = {
    "newest": newest,
    "compiled": compiled,
    "lowest": oldest,
}


def run(name: str, python: str, libraries: str) -> Outcome:
    """One Python with these libraries."""
    print(f"\nPython {name}, {libraries}", flush=True)
    began = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="python.") as folder:
        Path(folder).chmod(0o755)  # some tests are another user for a while, and import libraries
        try:
            text, passed = RUNS[libraries](Environment(python, Path(folder)))
        except CommandFailed as error:
            text, passed = str(error), False
    return Outcome(name, libraries, text, passed, time.monotonic() - began)


def musl() -> Outcome:
    """Whether each pinned library has a wheel for musl."""
    began, lacking = time.monotonic(), []
    for platform in PLATFORMS:
        command = ["uv", "pip", "install", "--quiet", "--dry-run", "--only-binary", ":all:", "--target", "/nonexistent"]
        pinned = ["--require-hashes", "--requirement", CHECKOUT / "deploy/requirements.txt"]
        if subprocess.run([*command, "--python-platform", platform, *pinned], check=False).returncode:
            lacking.append(platform)
    text = f"no wheels for {', '.join(lacking)}" if lacking else "every library has a wheel; nothing was run"
    return Outcome("musl", "pinned", text, not lacking, time.monotonic() - began)


def main() -> int:
    """Run what is asked for, and say in a table what came of it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pythons", nargs="*", metavar="PYTHON", help="versions or interpreters; all without any")
    parser.add_argument("--with", action="append", choices=RUNS, dest="libraries", help="what is run; all without any")
    args = parser.parse_args()
    outcomes, absent = [], []
    for name in args.pythons or (*PYTHONS, NEXT):
        python = find(name)
        if python:
            outcomes += [run(name, python, libraries) for libraries in args.libraries or RUNS]
        else:
            absent.append(name)
    outcomes.append(musl())
    print()
    for each in outcomes:
        verdict = "ok    " if each.passed else "FAILED"
        print(f"{verdict}  {each.python:8}  {each.libraries:8}  {each.seconds:4.0f} s  {each.text}")
    for name in absent:
        print(f"absent  {name}: neither uv nor Debian brings it here")
    return 0 if all(each.passed for each in outcomes) else 1


if __name__ == "__main__":
    sys.exit(main())
