"""What is packed: the libraries that run the gateway and no others, rules that udev understands, completion.

Whether the package installs and serves is seen by tests/soak/package.py, which builds it.
"""

import re
import shutil
import subprocess
import sys
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

from gateway.cli.main import VERBS

DEPLOY = Path(__file__).resolve().parents[2] / "deploy"
PROGRAM = Path(sys.executable).with_name("modbus-gateway")


def printed(*words: str | Path) -> str:
    """What a command prints."""
    return subprocess.run(words, capture_output=True, text=True, check=True).stdout


def asked_for(library: str) -> set[str]:
    """The libraries that this one asks for, and those that they ask for."""
    requirements = map(Requirement, metadata.requires(library) or ())
    names = {one.name for one in requirements if one.marker is None or one.marker.evaluate({"extra": ""})}
    return names.union(*map(asked_for, names))


def completed(*words: str) -> list[str]:
    """What bash offers for the last of these words, the first of which is the program."""
    script = 'source "$0"; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _modbus_gateway "$1"; echo "${COMPREPLY[@]}"'
    return printed("bash", "-c", script, DEPLOY / "completions/modbus-gateway", PROGRAM, *words).split()


def test_the_libraries_that_run_the_gateway_are_packed_and_no_others():
    packed = re.findall(r"^([\w-]+)==", printed(sys.executable, DEPLOY / "runtime-requirements"), re.MULTILINE)
    assert set(packed) == asked_for("mbgw")


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
