"""Whether sdist, wheels and Debian packages hold what was committed, and what their names promise."""

import re
import subprocess
import tempfile
from email.message import Message
from email.parser import HeaderParser
from pathlib import Path
from typing import Final
from zipfile import ZipFile

from checking.findings import Findings
from releasing.commit import committed, files_of_tar, project, version
from releasing.kinds import MACHINES, compiled_wheels, is_pure, machine_of

#: The class and the number of the machine in the header of a compiled module (ELF).
ELF: Final = {"x86_64": (2, 62), "aarch64": (2, 183), "armv7l": (1, 40)}
#: A link in the description, or a picture, that leads to a file beside it.
RELATIVE: Final = re.compile(r"\]\((?!https?:)[^)]*\)|src=\"(?!https?:)[^\"]*\"")


def check_sdist(findings: Findings, sdist: Path) -> None:
    """It holds every file of the commit, and nothing else."""
    with sdist.open("rb") as file:
        packed = {name.partition("/")[2]: content for name, content in files_of_tar(file)}
    _check_metadata(findings, sdist.name, packed.pop("PKG-INFO", b""))
    _compare(findings, sdist.name, packed, committed())


def check_wheel(findings: Findings, wheel: Path) -> None:
    """It holds the gateway as it was committed, and what its tags promise."""
    files = _files_of_wheel(wheel)
    folder = f"{'-'.join(wheel.name.split('-')[:2])}.dist-info/"
    _check_metadata(findings, wheel.name, files[f"{folder}METADATA"])
    inside = set(_headers(files[f"{folder}WHEEL"]).get_all("Tag", []))
    findings.expect(inside == _tags(wheel), f"{wheel.name}: other tags inside: {sorted(inside)}")
    sources = {
        name: content for name, content in files.items() if not name.startswith(folder) and not _is_compiled(name)
    }
    _compare(findings, wheel.name, sources, committed("gateway"))
    _check_compiled(findings, wheel, {name: content for name, content in files.items() if _is_compiled(name)})


def check_deb(findings: Findings, deb: Path) -> None:
    """It holds the gateway as it was committed, and the compiled modules of every wheel for its machine."""
    _, number, architecture = deb.stem.split("_")
    (machine,) = (machine for machine, name in MACHINES.items() if name == architecture)
    fields = subprocess.check_output(["dpkg-deb", "--field", deb, "Version", "Architecture"], text=True)
    findings.expect(fields == f"Version: {number}\nArchitecture: {architecture}\n", f"{deb.name}: {fields}")
    wanted = committed("gateway")
    for wheel in compiled_wheels(deb.parent, machine=machine):
        wanted |= {name: content for name, content in _files_of_wheel(wheel).items() if _is_compiled(name)}
    packed = {name.removeprefix("./usr/lib/modbus-gateway/"): content for name, content in _files_of_deb(deb).items()}
    _compare(findings, deb.name, {name: packed[name] for name in packed if name.startswith("gateway")}, wanted)


def _compare(findings: Findings, name: str, packed: dict[str, bytes], wanted: dict[str, bytes]) -> None:
    differing = sorted(file for file in packed.keys() | wanted.keys() if packed.get(file) != wanted.get(file))
    findings.expect(not differing, f"{name}: {len(differing)} files are not as they must be: {differing[:3]}")


def _check_metadata(findings: Findings, name: str, text: bytes) -> None:
    """The version and the addresses are those of the commit, and an index can follow every link in the description."""
    metadata = _headers(text)
    findings.expect(metadata["Version"] == version(), f"{name}: its version")
    addresses = dict(address.split(", ", 1) for address in metadata.get_all("Project-URL", []))
    findings.expect(addresses == project()["urls"], f"{name}: its addresses")
    description = str(metadata.get_payload())
    findings.expect(description.startswith("# "), f"{name}: no description")
    relative = RELATIVE.findall(description)
    findings.expect(not relative, f"{name}: links that lead nowhere on an index: {relative[:3]}")


def _check_compiled(findings: Findings, wheel: Path, modules: dict[str, bytes]) -> None:
    """They are for the machine and the Python in the wheel's name; a pure one has none."""
    findings.expect(bool(modules) != is_pure(wheel), f"{wheel.name}: {len(modules)} compiled modules")
    if is_pure(wheel):
        return
    for name, content in modules.items():
        header = (int.from_bytes(content[4:5]), int.from_bytes(content[18:20], "little"))
        findings.expect(header == ELF[machine_of(wheel)], f"{wheel.name}: {name} is for another machine")
        tag = wheel.stem.split("-")[2]
        findings.expect(f".cpython-{tag.removeprefix('cp')}-" in name, f"{wheel.name}: {name} is for another Python")


def _is_compiled(name: str) -> bool:
    return name.endswith(".so")


def _tags(wheel: Path) -> set[str]:
    python, abi, platforms = wheel.stem.split("-")[2:]
    return {f"{python}-{abi}-{platform}" for platform in platforms.split(".")}


def _headers(text: bytes) -> Message:
    return HeaderParser().parsestr(text.decode())


def _files_of_wheel(wheel: Path) -> dict[str, bytes]:
    with ZipFile(wheel) as archive:
        return {name: archive.read(name) for name in archive.namelist() if not name.endswith("/")}


def _files_of_deb(deb: Path) -> dict[str, bytes]:
    with tempfile.TemporaryFile() as file:
        subprocess.run(["dpkg-deb", "--fsys-tarfile", deb], stdout=file, check=True)
        file.seek(0)
        return dict(files_of_tar(file))
