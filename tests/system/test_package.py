"""What is packed: all of the gateway, the libraries that run it and no others, rules that udev understands.

Whether the package installs and serves is seen by tests/soak/package.py, which builds it.
"""

import ast
import os
import re
import shutil
import subprocess
import sys
import tarfile
import tomllib
from collections.abc import Iterator
from email.parser import HeaderParser
from importlib import metadata
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

from kit.wheel import asked_for, build

CHECKOUT = Path(__file__).resolve().parents[2]
DEPLOY = CHECKOUT / "deploy"


def printed(*words: str | Path) -> str:
    """What a command prints."""
    return subprocess.run(words, capture_output=True, text=True, check=True, cwd=CHECKOUT).stdout


def declared_project() -> dict[str, Any]:
    """What pyproject.toml says."""
    return tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))


def declared() -> list[Requirement]:
    """The libraries that the gateway asks for, also those of its extras."""
    project = declared_project()["project"]
    extras = (text for texts in project["optional-dependencies"].values() for text in texts)
    return [Requirement(text) for text in (*project["dependencies"], *extras)]


def pinned() -> dict[str, str]:
    """The version of each library that is packed."""
    text = (DEPLOY / "requirements.txt").read_text(encoding="utf-8")
    found = re.findall(r"^([\w-]+)==(\S+)", text, re.MULTILINE)
    return {canonicalize_name(name): version for name, version in found}


def imported() -> Iterator[str]:
    """The modules of others that the gateway imports somewhere."""
    for path in (CHECKOUT / "gateway").rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module] if isinstance(node, ast.ImportFrom) and node.module else []
            yield from {name.partition(".")[0] for name in names} - sys.stdlib_module_names - {"gateway"}


def test_the_gateway_imports_the_libraries_that_it_asks_for():
    of_module = metadata.packages_distributions() | {
        "pydantic_core": ["pydantic"]
    }  # a part of it, of a version of its own
    modules = set(imported()) - {"mypy_extensions"}  # what types are checked with: see gateway/compiler.py
    used = {canonicalize_name(library) for module in modules for library in of_module[module]}
    assert {canonicalize_name(one.name) for one in declared()} == used


def test_the_libraries_that_run_the_gateway_are_packed_and_no_others():
    assert set(pinned()) == set().union(*(asked_for(one.name) for one in declared()))


def test_they_are_of_versions_that_the_gateway_asks_for():
    assert [one for one in declared() if pinned()[canonicalize_name(one.name)] not in one.specifier] == []


def test_whoever_packs_them_takes_them_from_that_list():
    assert "deploy/requirements.txt" in (DEPLOY / "build-deb").read_text(encoding="utf-8")
    assert "uv sync --frozen" in (DEPLOY / "Dockerfile").read_text(encoding="utf-8")


def test_the_image_is_made_of_files_that_are_there_and_let_through():
    copied = re.findall(r"^COPY (?!--)(.*) \S+$", (DEPLOY / "Dockerfile").read_text(encoding="utf-8"), re.MULTILINE)
    files = {file for files in copied for file in files.split()}
    assert [file for file in files if not (CHECKOUT / file).exists()] == []
    let_through = (DEPLOY / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    assert {line[1:] for line in let_through if line.startswith("!")} == files - {"./"}


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Wheel and sdist, as a release has them."""
    folder = tmp_path_factory.mktemp("dist")
    build(folder, "-t", "sdist")
    return folder


@pytest.fixture
def wheel(built):
    """What is in the wheel."""
    (path,) = built.glob("*.whl")
    with ZipFile(path) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def member(files: dict[str, bytes], end: str) -> str:
    (content,) = (content for name, content in files.items() if name.endswith(end))
    return content.decode()


def test_the_wheel_has_every_file_of_the_gateway_and_its_commands(wheel):
    package = CHECKOUT / "gateway"
    files = [path for path in package.rglob("*") if path.is_file() and path.suffix not in {".po", ".pyc"}]
    assert {name for name in wheel if ".dist-info/" not in name} == {str(path.relative_to(CHECKOUT)) for path in files}
    commands = re.findall(r"^([\w-]+) = gateway\.cli\.main:main$", member(wheel, "entry_points.txt"), re.MULTILINE)
    assert set(commands) == {"modbus-gateway", "mbgw"}


def test_the_wheel_is_for_every_python_and_tells_type_checkers_that_it_is_typed(built, wheel):
    assert [path.name.endswith("-py3-none-any.whl") for path in built.glob("*.whl")] == [True]
    assert "gateway/py.typed" in wheel


def test_a_package_index_can_follow_every_link_of_the_readme(wheel):
    metadata = HeaderParser().parsestr(member(wheel, "METADATA"))
    described = metadata.get_payload()
    targets = re.findall(r"\]\(([^)]+)\)", described)
    assert len(targets) == (CHECKOUT / "README.md").read_text(encoding="utf-8").count("](")
    assert [target for target in targets if not target.startswith("https://")] == []
    addresses = dict(address.split(", ", 1) for address in metadata.get_all("Project-URL"))
    version = metadata["Version"]
    assert any(target.startswith(f"{addresses['Source']}/blob/v{version}/docs/") for target in targets)


def test_every_link_of_the_readme_leads_to_what_is_there(wheel):
    """As it is rewritten for an index: the path behind the version is one of the checkout's."""
    targets = re.findall(r"\]\(https://[^)]*/(?:blob|raw)/v[\d.]+/([^)#]+)", member(wheel, "METADATA"))
    assert "docs/lines-and-devices.md" in targets
    assert [target for target in targets if not (CHECKOUT / target).exists()] == []


def test_a_wheel_can_be_built_from_the_sdist_and_compiled_too(built):
    """It has what the build hook needs."""
    (sdist,) = built.glob("*.tar.gz")
    with tarfile.open(sdist) as archive:
        names = {name.partition("/")[2] for name in archive.getnames()}
    hook = declared_project()["tool"]["hatch"]["build"]["targets"]["wheel"]["hooks"]["custom"]
    assert {"README.md", "LICENSE", "gateway/py.typed", "deploy/compile", hook["path"]} <= names


@pytest.mark.parametrize(("wanted", "made"), [("", 1), ("1", 0)])
def test_a_wheel_that_cannot_be_compiled_is_pure_unless_it_must_be_compiled(tmp_path, wanted, made):
    wheels, said = wheels_built(tmp_path, CC="no-such-compiler", HATCH_BUILD_HOOK_ENABLE_CUSTOM=wanted)
    assert [name.endswith("-py3-none-any.whl") for name in wheels] == [True] * made, said
    assert "not compiled" in said
    assert "there is no no-such-compiler" in said


@pytest.mark.parametrize(("wanted", "made"), [("", 1), ("1", 0)])
def test_so_is_one_whose_compiler_fails(tmp_path, wanted, made):
    (tmp_path / "deploy").mkdir()
    (tmp_path / "deploy/compile").write_text("raise SystemExit('no room for objects')", encoding="utf-8")
    wheels, said = wheels_built(tmp_path, CC=sys.executable, HATCH_BUILD_HOOK_ENABLE_CUSTOM=wanted)
    assert [name.endswith("-py3-none-any.whl") for name in wheels] == [True] * made, said
    assert "not compiled" in said
    assert "deploy/compile has failed" in said


def wheels_built(folder: Path, **environment: str) -> tuple[list[str], str]:
    """The wheels that hatchling makes of the checkout, with what else is in a folder, and what it says."""
    for file in ("pyproject.toml", "README.md", "LICENSE", "deploy/wheel_hook.py", "deploy/compile", "gateway"):
        (folder / file).parent.mkdir(exist_ok=True)
        if not (folder / file).exists():
            (folder / file).symlink_to(CHECKOUT / file)
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel"]
    done = subprocess.run(
        command, cwd=folder, env=os.environ | environment, capture_output=True, text=True, check=False
    )
    return [path.name for path in (folder / "dist").glob("*.whl")], done.stderr


def test_the_package_admits_the_pythons_for_which_it_has_libraries():
    build = (DEPLOY / "build-deb").read_text(encoding="utf-8")
    minors = [int(minor) for minor in re.findall(r"3\.(\d+)", build.partition('pythons="')[2].partition('"')[0])]
    control = (DEPLOY / "debian/control").read_text(encoding="utf-8")
    assert minors == list(range(minors[0], minors[-1] + 1))
    assert f"python3 (>= 3.{minors[0]}~), python3 (<< 3.{minors[-1] + 1}~)" in control


BUILDERS_TOOLS = {
    "dpkg": "echo amd64",
    "dh": "true",
    "python3": "echo python3 $* >&2",
    "dpkg-architecture": 'touch "$OUT/modbus-gateway_0_amd64.deb"',
}


def test_who_builds_the_package_sees_how_far_it_is(tmp_path):
    """With other programs in place of those that take minutes: what they are told to do stands behind each step."""
    tools = tmp_path / "tools"
    for folder in ("deploy/debian", "deploy/udev", "docs", "gateway", "systemd", "tests", "tools"):
        (tmp_path / folder).mkdir(parents=True)
    for file in (
        "CHANGELOG.md",
        "CONTRIBUTING.md",
        "README.md",
        "LICENSE",
        "tests/README.md",
        "deploy/udev/modbus-gateway.rules",
    ):
        (tmp_path / file).touch()
    (tmp_path / "deploy/debian/control").write_text("Maintainer: somebody <x@y.example>\n")
    everywhere, elsewhere = (
        "a==1 \\\n    --hash=b\n",
        "c==1 ; platform_machine in 'x86_64' \\\n    --hash=d \\\n    --hash=e\n",
    )
    (tmp_path / "deploy/requirements.txt").write_text(everywhere + elsewhere + everywhere)
    (tmp_path / "gateway/version.py").write_text('__version__ = "0"\n')
    (tmp_path / "systemd/modbus-gateway.service").touch()
    shutil.copy(DEPLOY / "build-deb", tmp_path / "deploy")
    for name, does in BUILDERS_TOOLS.items():
        (tools / name).write_text(f"#!/bin/sh\n{does}\n")
        (tools / name).chmod(0o755)
    environment = {"PATH": f"{tools}:{os.environ['PATH']}", "OUT": str(tmp_path / "dist"), "SOURCE_DATE_EPOCH": "0"}
    done = subprocess.run(
        [tmp_path / "deploy/build-deb"], capture_output=True, text=True, check=True, cwd=tmp_path, env=environment
    )
    steps = [line for line in done.stderr.splitlines() if not line.startswith("python3 -m zipfile")]
    versions = ["3.11", "3.12", "3.13", "3.14"]
    fetching = [f"fetching libraries for Python {each} ..." for each in versions]
    *fetched, pages, installed, written, last = steps
    assert fetched[::2] == fetching
    assert [re.findall(r"--python-version (\S+)", step) for step in fetched[1::2]] == [[each] for each in versions]
    assert (pages, last) == ("writing the manual pages ...", "building the package ...")
    assert ("--target" in installed, "deploy.manual_pages" in written) == (True, True)
    assert "\n -- somebody <x@y.example>  " in (tmp_path / "build/deb/debian/changelog").read_text()
    assert done.stdout.strip().endswith("dist/modbus-gateway_0_amd64.deb")
    requirements = tmp_path / "build/deb/requirements.txt"
    assert requirements.read_text() == everywhere + elsewhere + everywhere
    subprocess.run([tmp_path / "deploy/build-deb", "armhf"], capture_output=True, check=False, env=environment)
    assert requirements.read_text() == everywhere * 2


def test_who_installs_with_pipx_is_told_every_extra():
    extras = ",".join(declared_project()["project"]["optional-dependencies"])
    page = (CHECKOUT / "docs/install.md").read_text(encoding="utf-8")
    commands = re.findall(r"(?:pipx|tool) install.*?\[(.*?)\]", page)
    assert commands
    assert set(commands) == {extras}


def test_udev_understands_the_rules():
    if not shutil.which("udevadm") or "verify" not in printed("udevadm", "--help"):
        pytest.skip("there is no udevadm that verifies rules (package udev of Debian 13)")
    printed("udevadm", "verify", DEPLOY / "udev/modbus-gateway.rules")


def test_what_the_pages_name_is_in_the_package_as_it_is_in_the_checkout():
    """What is compressed could not be installed by the commands in its own header."""
    packed = (DEPLOY / "debian/install").read_text() + (DEPLOY / "debian/examples").read_text()
    pages = " ".join(page.read_text(encoding="utf-8") for page in (CHECKOUT / "docs").glob("*.md"))
    named = {each for each in re.findall(r"deploy/([a-z]+)\b", pages) if (DEPLOY / each).is_dir()}
    of_checkouts = {"debian", "homeassistant"}
    assert {"keepalived", "udev"} <= named
    assert [each for each in sorted(named - of_checkouts) if f"deploy/{each}" not in packed] == []
    (compress,) = re.findall(r"dh_compress (.*)", (DEPLOY / "debian/rules").read_text())
    assert "--exclude=.conf" in compress


def test_the_pages_in_the_package_lead_to_what_is_there(tmp_path):
    """As tests/soak/package.py sees it where it is installed."""
    folder = "usr/share/doc/modbus-gateway"
    packed = [(name, name) for name in (DEPLOY / "debian/docs").read_text().split()]
    for source, *target in map(str.split, (DEPLOY / "debian/install").read_text().splitlines()):
        if target[0].startswith(folder):
            packed.append((source, f"{target[0].removeprefix(folder)}/{Path(source).name}".strip("/")))
    packed += [("gateway", "gateway"), ("deploy/examples", "deploy/examples")]  # debian/links
    for source, target in packed:
        (tmp_path / target).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / target).symlink_to(CHECKOUT / source)
    pages = [page for source, _ in packed for page in (CHECKOUT / source, *(CHECKOUT / source).rglob("*.md"))]
    missing = [
        f"{page.relative_to(CHECKOUT)}: {target}"
        for page in pages
        if page.suffix == ".md"
        for target in re.findall(r"\]\((?!http)([^)#]+)", page.read_text(encoding="utf-8"))
        if not Path(os.path.normpath(tmp_path / page.relative_to(CHECKOUT).parent / target)).exists()
    ]
    assert missing == []
