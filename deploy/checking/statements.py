"""Whether checksums, provenance, SBOM and tag are those of these files and of this commit."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

from checking.findings import Findings
from releasing.commit import commit_id, git, version

SUMS = "SHA256SUMS"


def check_sums(findings: Findings, dist: Path) -> dict[str, str]:
    """Each file has the checksum that is listed, and none is without one; the list."""
    lines = (dist / SUMS).read_text(encoding="utf-8").splitlines()
    listed = {name: digest for digest, name in (line.split("  ") for line in lines)}
    found = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in dist.iterdir() if path.name != SUMS}
    for name in sorted(listed.keys() | found.keys()):
        findings.expect(listed.get(name) == found.get(name), f"{name}: its checksum is not the listed one")
    return listed


def check_provenance(findings: Findings, dist: Path, listed: dict[str, str]) -> None:
    """It names these files, with these checksums, and this commit."""
    name, statement = _only(dist, "*.intoto.json")
    subjects = {subject["name"]: subject["digest"]["sha256"] for subject in statement["subject"]}
    findings.expect(subjects | {name: listed.get(name)} == listed, f"{name}: its subjects are not the files")
    (source,) = (
        dependency["digest"]["gitCommit"]
        for dependency in statement["predicate"]["buildDefinition"]["resolvedDependencies"]
        if "gitCommit" in dependency["digest"]
    )
    findings.expect(source == commit_id(), f"{name}: made of commit {source}")


def check_tags(findings: Findings, tags: list[str]) -> None:
    """A tag of the commit names the version that was built: a release is fetched by its tag."""
    for tag in tags:
        findings.expect(tag == f"v{version()}", f"the tag {tag}: gateway/version.py says {version()}")


def check_sbom(findings: Findings, dist: Path) -> None:
    """It lists the libraries that are pinned, in their versions, and no others."""
    name, content = _only(dist, "*.cdx.json")
    listed = {(_normal(one["name"]), one["version"]) for one in content["components"]}
    text = git("show", "HEAD:deploy/requirements.txt").decode()
    pinned = {
        (_normal(library), number) for library, number in re.findall(r"^([\w.-]+)==([^\s;]+)", text, re.MULTILINE)
    }
    findings.expect(listed == pinned, f"{name}: not as pinned: {sorted(listed ^ pinned)}")
    findings.expect(content["metadata"]["component"].get("version") == version(), f"{name}: its version")


def _only(dist: Path, pattern: str) -> tuple[str, Any]:
    (file,) = dist.glob(pattern)
    return file.name, json.loads(file.read_text(encoding="utf-8"))


def _normal(library: str) -> str:
    """The name as package indexes compare it."""
    return re.sub(r"[-_.]+", "-", library).lower()
