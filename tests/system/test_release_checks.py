"""What `deploy/check-release` notices: what was built of the last commit passes, and each damage to it is named."""

import os
import subprocess
import sys
from datetime import UTC, datetime
from functools import cache
from pathlib import Path
from zipfile import ZipFile

import pytest

from checking import contents, statements
from checking.contents import check_sdist, check_wheel
from checking.findings import Findings
from checking.statements import check_provenance, check_sums, check_tags
from releasing.commit import commit_id, committed, export, project, version
from releasing.packages import Workshop
from releasing.statements import write_provenance, write_sums

pytestmark = pytest.mark.search


@pytest.fixture(scope="module", autouse=True)
def _commit_is_read_once():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(contents, "committed", cache(committed))
        patch.setattr(contents, "project", cache(project))
        for module in (contents, statements):
            patch.setattr(module, "version", cache(version))
        yield


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Sdist and pure wheel of the last commit: their contents."""
    folder = tmp_path_factory.mktemp("release")
    export(folder / "source")
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-t", "sdist", "-d", folder / "dist"]
    pure = os.environ | {"HATCH_BUILD_NO_HOOKS": "true"}
    subprocess.run(command, check=True, cwd=folder / "source", capture_output=True, env=pure)
    return {path.name: path.read_bytes() for path in (folder / "dist").iterdir()}


@pytest.fixture
def dist(built, tmp_path):
    """A release of them, with statements."""
    dist = tmp_path / "dist"
    dist.mkdir()
    for name, content in built.items():
        (dist / name).write_bytes(content)
    shop = Workshop(commit_id(), tmp_path, tmp_path, dist, version())
    write_provenance(shop, datetime.now(UTC), "", [])
    write_sums(shop)
    return dist


@pytest.fixture
def wheel(dist):
    (wheel,) = dist.glob("*.whl")
    return wheel


def found(dist: Path) -> list[str]:
    """What is wrong with it."""
    findings = Findings()
    check_provenance(findings, dist, check_sums(findings, dist))
    for sdist in dist.glob("*.tar.gz"):
        check_sdist(findings, sdist)
    for wheel in dist.glob("*.whl"):
        check_wheel(findings, wheel)
    return findings.wrong


def rewrite(wheel: Path, change) -> None:
    """Pack it again with other contents."""
    with ZipFile(wheel) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    change(files)
    with ZipFile(wheel, "w") as archive:
        for name, content in files.items():
            archive.writestr(name, content)


def test_what_was_built_of_the_commit_passes(dist):
    assert found(dist) == []


def test_a_file_that_is_not_listed_and_one_that_has_changed(dist, wheel):
    (dist / "stray.whl.part").write_bytes(b"")
    (dist / "SHA256SUMS").write_text((dist / "SHA256SUMS").read_text().replace(" mbgw", " other", 1))
    names = [what.partition(":")[0] for what in found(dist) if "checksum" in what]
    assert "stray.whl.part" in names
    assert len(names) == 3


def test_another_commit(dist):
    (statement,) = dist.glob("*.intoto.json")
    statement.write_text(statement.read_text().replace('"gitCommit": "', '"gitCommit": "0'))
    assert any("made of commit 0" in what for what in found(dist))


def test_a_tag_that_is_not_the_version():
    findings = Findings()
    check_tags(findings, [f"v{version()}", "v9.9.9"])
    assert findings.wrong == [f"the tag v9.9.9: gateway/version.py says {version()}"]


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda files: files.update({"gateway/request.py": b""}), "gateway/request.py"),
        (lambda files: files.pop("gateway/py.typed"), "gateway/py.typed"),
        (lambda files: files.update({"gateway/stray.py": b""}), "gateway/stray.py"),
        (lambda files: files.update({"tests/stray.py": b""}), "tests/stray.py"),
        (lambda files: files.update({"gateway/request.cpython-311-x86_64-linux-gnu.so": b""}), "1 compiled modules"),
        (lambda files: damage(files, "WHEEL", b"py3-none-any", b"cp311-cp311-linux_x86_64"), "other tags inside"),
        (lambda files: damage(files, "METADATA", b"\nVersion: ", b"\nVersion: 9"), "its version"),
        (lambda files: damage(files, "METADATA", b"](https://", b"](../"), "lead nowhere"),
        (lambda files: damage(files, "METADATA", b"Project-URL: Source, ", b"Project-URL: Source, x"), "its addresses"),
    ],
)
def test_a_wheel_that_is_not_what_it_says(dist, wheel, change, what):
    rewrite(wheel, change)
    assert any(wheel.name in each and what in each for each in found(dist))


def damage(files: dict[str, bytes], end: str, old: bytes, new: bytes) -> None:
    (name,) = (name for name in files if name.endswith(f".dist-info/{end}"))
    assert old in files[name]
    files[name] = files[name].replace(old, new, 1)


def test_a_wheel_for_another_python_or_machine(dist, wheel):
    elf = bytes((0x7F, *b"ELF", 2)) + bytes(13) + (62).to_bytes(2, "little")
    rewrite(wheel, lambda files: files.update({"gateway/request.cpython-312-x86_64-linux-gnu.so": elf}))
    wheel.rename(wheel.with_name(f"mbgw-{version()}-cp311-cp311-manylinux_2_17_aarch64.whl"))
    wrong = found(dist)
    assert any("is for another Python" in what for what in wrong)
    assert any("is for another machine" in what for what in wrong)


def test_a_sdist_that_lacks_something(dist):
    (sdist,) = dist.glob("*.tar.gz")
    with_less = subprocess.run(
        ["git", "archive", "--format=tar.gz", f"--prefix=mbgw-{version()}/", "HEAD", "gateway", "pyproject.toml"],
        cwd=Path(__file__).parents[2],
        capture_output=True,
        check=True,
    ).stdout
    sdist.write_bytes(with_less)
    wrong = found(dist)
    assert any(f"{sdist.name}: its version" in what for what in wrong)
    assert any(sdist.name in what and "are not as they must be" in what for what in wrong)
