"""The project's addresses: a change of deploy/project.toml reaches every file, and a release wants all of them."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from addresses import UNRELEASED, hindrances, main, wanted, write, written

CHECKOUT = Path(__file__).resolve().parents[2]
PLACEHOLDER = re.compile(rb"[\w.+-]*@?\b(?:[\w-]+\.)*modbus-gateway\.example\S*")
NEW = {
    "source": "https://git.plant/acme/modbus-gateway",
    "documentation": "https://acme.plant/modbus-gateway",
    "image": "registry.plant/acme/modbus-gateway",
    "apt_key": "0123456789ABCDEF0123456789ABCDEF01234567",
    "maintainer": "Wang Fang <wang@acme.plant>",
}


SMALL = {
    "pyproject.toml",
    "CHANGELOG.md",
    "gateway/version.py",
    "README.md",
    "docs/install.md",
    "docs/zh/install.md",
    "deploy/homeassistant/repository.yaml",
}


def copied(names: set[str], root: Path) -> Path:
    """Some files of the checkout in a repository of their own."""
    for name in (*names, "deploy/project.toml"):
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(CHECKOUT / name, root / name)
    subprocess.run(["git", "init", "-q", root], check=True)
    subprocess.run(["git", "add", "--all"], cwd=root, check=True)
    return root


@pytest.fixture
def everything(tmp_path):
    """All but tests, profiles and pictures."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=CHECKOUT, capture_output=True, text=True, check=True).stdout
    names = {name for name in listed.split("\0") if name and (CHECKOUT / name).is_file()}
    left_out = ("tests/", "profiles/", "docs/pictures/")
    return copied({name for name in names if not name.startswith(left_out)}, tmp_path)


@pytest.fixture
def some(tmp_path):
    return copied(SMALL, tmp_path)


def fill_in(root: Path, addresses: dict[str, str]) -> None:
    lines = [f'{name} = "{text}"' for name, text in addresses.items()]
    (root / "deploy/project.toml").write_text("\n".join(lines))


def texts(root: Path) -> dict[str, bytes]:
    files = (path for path in root.rglob("*") if path.is_file() and ".git" not in path.relative_to(root).parts)
    return {str(path.relative_to(root)): path.read_bytes() for path in files}


def test_one_file_changes_all_addresses(everything):
    fill_in(everything, NEW)
    (old,) = re.findall(r"^Source = \"(.*)\"", (everything / "pyproject.toml").read_text(), re.MULTILINE)
    write(everything)
    assert [name for name, text in texts(everything).items() if PLACEHOLDER.search(text) or old.encode() in text] == []
    assert written(everything) == NEW
    page = (everything / "docs/install.md").read_text()
    assert "git clone https://git.plant/acme/modbus-gateway modbus-gateway" in page
    assert "Wang Fang <wang@acme.plant>" in (everything / "deploy/homeassistant/repository.yaml").read_text()


def test_and_changes_them_again_and_back(some):
    (some / "other.md").write_text(f"{NEW['source']}-tools {NEW['image']}-tools")  # of somebody else
    subprocess.run(["git", "add", "other.md"], cwd=some, check=True)
    before = texts(some)
    longer = NEW | {"source": f"{NEW['source']}-2", "documentation": f"{NEW['source']}/docs"}
    old = written(some)
    for addresses in (NEW, longer, old):
        fill_in(some, addresses)
        write(some)
        write(some)
    after = texts(some)
    del before["deploy/project.toml"], after["deploy/project.toml"]
    assert after == before


def test_no_file_is_stale():
    assert wanted(CHECKOUT) == written(CHECKOUT)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("source", "git@git.plant:acme/modbus-gateway"),
        ("source", "https://git.plant/acme/modbus-gateway/"),
        ("documentation", "https://git.plant/acme/modbus-gateway"),
        ("image", "modbus-gateway"),
        ("image", "registry.plant/acme/modbus-gateway:latest"),
        ("apt_key", "0123 4567"),
        ("maintainer", "Wang Fang"),
    ],
)
def test_what_is_no_address_changes_nothing(some, name, text):
    before = texts(some)
    fill_in(some, NEW | {name: text})
    with pytest.raises(SystemExit):
        write(some)
    del before["deploy/project.toml"]
    assert before.items() <= texts(some).items()


def test_a_release_wants_addresses_and_its_version_and_its_changes(some):
    version = "7.0.1"
    (some / "gateway/version.py").write_text(f'__version__ = "{version}"\n')
    (some / "CHANGELOG.md").write_text(f"## {version}, not released yet\n")
    for page in UNRELEASED:  # as all of them do until the first release
        (some / page).write_text("What ends in `.example` is a placeholder.\n")
    example = {name: text.replace(".plant", ".example") for name, text in NEW.items()}
    fill_in(some, example | {"apt_key": "FINGERPRINT.example"})
    assert hindrances(some, "v7.0") == [
        *(f"deploy/project.toml: {name} is a placeholder" for name in NEW),
        "deploy/project.toml is not what stands in the files: nox -s gen",
        *(f"{page} says that there is no release: delete the sentence with `.example`" for page in UNRELEASED),
        "the tag is v7.0, and gateway/version.py says 7.0.1",
        "CHANGELOG.md does not say that 7.0.1 is released",
    ]
    fill_in(some, NEW)
    (some / "CHANGELOG.md").write_text(f"## {version}, 2030-01-02\n")
    for page in UNRELEASED:
        (some / page).write_text("To be had.\n")
    assert hindrances(some, "v7.0.1") == ["deploy/project.toml is not what stands in the files: nox -s gen"]
    write(some)
    assert hindrances(some, "v7.0.1") == []


def test_the_changes_begin_with_those_of_this_version():
    (version,) = re.findall(r'^__version__ = "(.*)"', (CHECKOUT / "gateway/version.py").read_text(), re.MULTILINE)
    assert re.findall("^## ([^,]+),", (CHECKOUT / "CHANGELOG.md").read_text(), re.MULTILINE)[0] == version


def test_the_command_says_no(monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["addresses.py", "--release", "v0.0.0"])
    assert main() == 1
    assert "the tag is v0.0.0" in capsys.readouterr().err
