"""What is packed: all of the gateway, the libraries that run it and no others, rules that udev understands, completion.

Whether the package installs and serves is seen by tests/soak/package.py, which builds it.
"""

import ast
import re
import shutil
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from importlib import metadata
from pathlib import Path
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement

from gateway.cli.main import VERBS

CHECKOUT = Path(__file__).resolve().parents[2]
DEPLOY = CHECKOUT / "deploy"
PROGRAM = Path(sys.executable).with_name("modbus-gateway")


def printed(*words: str | Path) -> str:
    """What a command prints."""
    return subprocess.run(words, capture_output=True, text=True, check=True, cwd=CHECKOUT).stdout


def declared() -> list[Requirement]:
    """The libraries that the gateway asks for."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    return [Requirement(text) for text in project["dependencies"]]


def pinned() -> dict[str, str]:
    """The version of each library that is packed."""
    text = (DEPLOY / "requirements.txt").read_text(encoding="utf-8")
    return dict(re.findall(r"^([\w-]+)==(\S+)", text, re.MULTILINE))


def asked_for(library: str) -> set[str]:
    """This library, those that it asks for, and those that they ask for."""
    asked = map(Requirement, metadata.requires(library) or ())
    names = {one.name for one in asked if one.marker is None or one.marker.evaluate({"extra": ""})}
    return {library}.union(*map(asked_for, names))


def imported() -> Iterator[str]:
    """The modules of others that the gateway imports somewhere."""
    for path in (CHECKOUT / "gateway").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            yield from {name.partition(".")[0] for name in names} - sys.stdlib_module_names - {"gateway"}


def completed(*words: str) -> list[str]:
    """What bash offers for the last of these words, the first of which is the program."""
    script = 'source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _modbus_gateway "$1"; echo "${COMPREPLY[@]}"'
    return printed("bash", "-c", script, DEPLOY / "completions/modbus-gateway", PROGRAM, *words).split()


def test_the_gateway_imports_the_libraries_that_it_asks_for():
    of_module = metadata.packages_distributions() | {
        "pydantic_core": ["pydantic"]
    }  # a part of it, of a version of its own
    used = {library for module in imported() for library in of_module[module]}
    waiting = {"pymodbus"}  # see docs/adr/0001-dependencies.md
    assert {one.name for one in declared()} == used | waiting
    assert not used & waiting


def test_the_libraries_that_run_the_gateway_are_packed_and_no_others():
    assert set(pinned()) == set().union(*(asked_for(one.name) for one in declared()))


def test_they_are_of_versions_that_the_gateway_asks_for():
    assert [one for one in declared() if pinned()[one.name] not in one.specifier] == []


@pytest.mark.parametrize("builder", ["build-deb", "Dockerfile", "Dockerfile.dockerignore"])
def test_whoever_packs_them_takes_them_from_that_list(builder):
    named = re.findall(r"deploy/[\w-]*requirements[\w-]*.*", (DEPLOY / builder).read_text(encoding="utf-8"))
    assert [re.split(r"[ \"]", words)[0] for words in named] == ["deploy/requirements.txt"]


def test_the_wheel_has_every_file_of_the_gateway_and_its_commands(tmp_path):
    printed(sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", tmp_path)
    (wheel,) = tmp_path.iterdir()
    with ZipFile(wheel) as archive:
        names = archive.namelist()
        (commands,) = (archive.read(name).decode() for name in names if name.endswith("entry_points.txt"))
    package = CHECKOUT / "gateway"
    files = [path for path in package.rglob("*") if path.is_file() and path.suffix != ".pyc"]
    assert {name for name in names if ".dist-info/" not in name} == {str(path.relative_to(CHECKOUT)) for path in files}
    assert set(re.findall(r"^([\w-]+) = gateway\.cli\.main:main$", commands, re.MULTILINE)) == {
        "modbus-gateway",
        "mbgw",
    }


def test_the_package_admits_the_pythons_for_which_it_has_libraries():
    build = (DEPLOY / "build-deb").read_text(encoding="utf-8")
    minors = [int(minor) for minor in re.findall(r"3\.(\d+)", build.partition('pythons="')[2].partition('"')[0])]
    control = (DEPLOY / "debian/control").read_text(encoding="utf-8")
    assert minors == list(range(minors[0], minors[-1] + 1))
    assert f"python3 (>= 3.{minors[0]}~), python3 (<< 3.{minors[-1] + 1}~)" in control


def test_completion_knows_every_verb():
    assert set(completed("")) == set(VERBS)


def test_completion_knows_the_options_of_a_verb():
    assert completed("check", "--j") == ["--json"]


def test_udev_understands_the_rules():
    if not shutil.which("udevadm") or "verify" not in printed("udevadm", "--help"):
        pytest.skip("there is no udevadm that verifies rules (package udev of Debian 13)")
    printed("udevadm", "verify", DEPLOY / "udev/modbus-gateway.rules")
