"""Writes what a release says of itself: SBOM, provenance, checksums."""

import hashlib
import json
from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path

from releasing.commands import output, run
from releasing.commit import project
from releasing.packages import Workshop


def write_sbom(shop: Workshop) -> None:
    """List the gateway and the pinned libraries, as they lie in a fresh environment (CycloneDX)."""
    environment, file = shop.work / "environment", shop.dist / f"mbgw-{shop.version}.cdx.json"
    install = ("uv", "pip", "install", "--quiet", "--python", environment / "bin/python")
    run("uv", "venv", "--quiet", environment)
    run(*install, "--require-hashes", "--requirement", shop.source / "deploy/requirements.txt")
    run(*install, "--no-deps", *shop.dist.glob("*-none-any.whl"))
    run(
        *("cyclonedx-py", "environment", environment, "--pyproject", shop.source / "pyproject.toml"),
        *("--mc-type", "application", "--output-reproducible", "--output-file", file),
    )
    content = json.loads(file.read_text(encoding="utf-8"))
    # cyclonedx-py knows no version that pyproject.toml leaves to the build.
    content["metadata"]["component"] |= {"version": shop.version, "purl": f"pkg:pypi/mbgw@{shop.version}"}
    _write(file, content)


def write_provenance(shop: Workshop, began: datetime, builder: str, arguments: list[str]) -> None:
    """State what was built, from what and by whom: an in-toto statement with SLSA's predicate. It is not signed."""
    commit, repository = shop.commit, project(shop.commit)["urls"]["Source"]
    pinned = _sums((shop.source / "deploy").glob("requirements*.txt"))
    definition = {
        "buildType": f"{repository}/deploy/release",
        "externalParameters": {"arguments": arguments},
        "internalParameters": {
            tool: output(tool, "--version").partition("\n")[0] for tool in ("cc", "uv", "auditwheel")
        },
        "resolvedDependencies": [
            {"uri": f"git+{repository}@{commit}", "digest": {"gitCommit": commit}},
            *({"uri": f"deploy/{name}", "digest": {"sha256": digest}} for name, digest in pinned.items()),
        ],
    }
    details = {
        "builder": {"id": builder or f"{repository}/deploy/release#by-hand"},
        "metadata": {"startedOn": _utc(began), "finishedOn": _utc(datetime.now(UTC))},
    }
    statement = {
        "_type": "https://in-toto.io/Statement/v1",
        "subject": [
            {"name": name, "digest": {"sha256": digest}} for name, digest in _sums(shop.dist.iterdir()).items()
        ],
        "predicateType": "https://slsa.dev/provenance/v1",
        "predicate": {"buildDefinition": definition, "runDetails": details},
    }
    _write(shop.dist / f"mbgw-{shop.version}.intoto.json", statement)


def write_sums(shop: Workshop) -> None:
    """Write SHA256SUMS, as `sha256sum --check` reads it."""
    lines = [f"{digest}  {name}\n" for name, digest in _sums(shop.dist.iterdir()).items()]
    (shop.dist / "SHA256SUMS").write_text("".join(lines), encoding="utf-8")


def _sums(files: Iterable[Path]) -> dict[str, str]:
    return {file.name: hashlib.sha256(file.read_bytes()).hexdigest() for file in sorted(files)}


def _utc(moment: datetime) -> str:
    return moment.strftime("%Y-%m-%dT%H:%M:%SZ")


def _write(file: Path, content: object) -> None:
    file.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
