"""Write the addresses of deploy/project.toml into every file of the checkout that has them.

    python deploy/addresses.py                 a part of `nox -s gen`
    python deploy/addresses.py --check         status 1 if that would change a file
    python deploy/addresses.py --release v1.2.3    status 1, and why, if the tag cannot be released as it is

Which addresses stand in the files now is known from pyproject.toml, where all of them are.
"""

import argparse
import re
import subprocess
import sys
import tomllib
from pathlib import Path
from typing import Any, Final

ROOT: Final = Path(__file__).resolve().parents[1]
FILE: Final = "deploy/project.toml"
RECORD: Final = "pyproject.toml"
#: Pages that say, as long as there is no release, what an address in `.example` means.
UNRELEASED: Final = ("README.md", "docs/install.md", "docs/zh/install.md")
FORMS: Final = {
    "source": r"https://[^/\s]+/\S*[^/\s]",
    "documentation": r"https://\S*[^/\s]",
    "image": r"[a-z0-9.:-]+/[a-z0-9._/-]*[a-z0-9]",
    "apt_key": r"[0-9A-F]{40}|\S+\.example",
    "maintainer": r'[^<>"]*[^<>"\s] <[^<>@"\s]+@[^<>@"\s]+>',
}


def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8"))


def wanted(root: Path) -> dict[str, str]:
    """Return the addresses of deploy/project.toml; the end, if one cannot be one."""
    addresses = _read(root / FILE)
    if addresses.keys() != FORMS.keys():
        sys.exit(f"{FILE}: wants exactly {', '.join(FORMS)}")
    for name, form in FORMS.items():
        if not re.fullmatch(form, addresses[name]):
            sys.exit(f"{FILE}: {name} is not like {form}")
    if addresses["source"] == addresses["documentation"]:
        sys.exit(f"{FILE}: source and documentation are the same, and could not be told apart later")
    return addresses


def written(root: Path) -> dict[str, str]:
    """Return the addresses that stand in the files now."""
    record = _read(root / RECORD)
    urls, (maintainer,) = record["project"]["urls"], record["project"]["maintainers"]
    return {
        "source": urls["Source"],
        "documentation": urls["Documentation"],
        "image": urls["Container image"].removeprefix("https://"),
        "apt_key": record["tool"]["mbgw"]["apt-key"],
        "maintainer": f"{maintainer['name']} <{maintainer['email']}>",
    }


def _spellings(addresses: dict[str, str]) -> list[str]:
    """Return each address as files spell it; a name alone is none, as it may be any word."""
    maintainer = addresses["maintainer"]
    name, mail = maintainer.removesuffix(">").split(" <")
    return [
        *(addresses[key] for key in ("source", "documentation", "image", "apt_key")),
        *(maintainer, f'name = "{name}", email = "{mail}"', mail),
    ]


def write(root: Path) -> None:
    """Replace what stands in the files by what is wanted; the record of it comes last."""
    if wanted(root) == written(root):
        return
    new = dict(zip(_spellings(written(root)), _spellings(wanted(root)), strict=True))
    longest_first = "|".join(re.escape(each) for each in sorted(new, key=len, reverse=True))
    pattern = re.compile(rf"(?:{longest_first})(?![\w-])")
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=root, stdout=subprocess.PIPE, check=True).stdout
    names = set(listed.decode().split("\0")) - {"", FILE, RECORD}
    for path in (root / name for name in (*sorted(names), RECORD)):
        try:
            text = path.read_bytes().decode()
        except (UnicodeDecodeError, OSError):  # a picture, or a file that was removed and is not committed
            continue
        if (changed := pattern.sub(lambda found: new[found[0]], text)) != text:
            path.write_bytes(changed.encode())
            print(path.relative_to(root))


def hindrances(root: Path, tag: str) -> list[str]:
    """Return why this tag cannot be released as it is."""
    (version,) = re.findall(r'^__version__ = "(.*)"$', (root / "gateway/version.py").read_text("utf-8"), re.MULTILINE)
    changes = re.findall(rf"^## {re.escape(version)}\b.*$", (root / "CHANGELOG.md").read_text("utf-8"), re.MULTILINE)
    found = [f"{FILE}: {name} is a placeholder" for name, text in wanted(root).items() if ".example" in text]
    if wanted(root) != written(root):
        found.append(f"{FILE} is not what stands in the files: nox -s gen")
    pages = (page for page in UNRELEASED if "`.example`" in (root / page).read_text("utf-8"))
    found += (f"{page} says that there is no release: delete the sentence with `.example`" for page in pages)
    if tag != f"v{version}":
        found.append(f"the tag is {tag}, and gateway/version.py says {version}")
    if not changes or "not released" in changes[0]:
        found.append(f"CHANGELOG.md does not say that {version} is released")
    return found


def main() -> int:
    """Read the arguments and do it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--release", metavar="TAG")
    args = parser.parse_args()
    if args.release:
        found = hindrances(ROOT, args.release)
    elif args.check:
        found = [] if wanted(ROOT) == written(ROOT) else [f"{FILE} has changed: nox -s gen"]
    else:
        write(ROOT)
        found = []
    print("\n".join(found), file=sys.stderr, end="\n" if found else "")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
