"""Builds sdist, wheels, Debian packages and container image."""

import os
import platform
import shutil
from dataclasses import dataclass, field
from pathlib import Path

from releasing.commands import python_here, run
from releasing.kinds import MACHINES, PYTHONS, compiled_wheels, tag_of


@dataclass
class Workshop:
    """Where is built: `source` holds the commit's files and nothing else, `dist` gets the release."""

    commit: str
    source: Path
    work: Path
    dist: Path
    version: str
    missing: list[str] = field(default_factory=list)


def get_tools(shop: Workshop) -> None:
    """Install what is pinned for building; commands find it behind everything else."""
    tools = shop.work / "tools"
    pinned = shop.source / "deploy/requirements-release.txt"
    run("uv", "venv", "--quiet", tools)
    run(
        "uv", "pip", "install", "--quiet", "--python", tools / "bin/python", "--require-hashes", "--requirement", pinned
    )
    os.environ["PATH"] += f"{os.pathsep}{tools / 'bin'}"


def build_sdist_and_pure_wheel(shop: Workshop) -> None:
    """Build the sdist, and the wheel from the sdist, which is thereby seen to be complete."""
    _build(shop, shop.source, folder=shop.dist, HATCH_BUILD_NO_HOOKS="true")
    (shop.dist / ".gitignore").unlink(missing_ok=True)  # uv's


def build_compiled_wheels(shop: Workshop) -> None:
    """Build a wheel for this kind of machine and each Python, tagged with the oldest system that it runs on."""
    machine = platform.machine()
    for python in PYTHONS:
        if compiled_wheels(shop.dist, python=python, machine=machine):
            continue
        if not python_here(python):
            shop.missing.append(f"the wheel for Python {python} on {machine}: uv neither finds nor brings this Python")
            continue
        raw = shop.work / tag_of(python)
        sdist = shop.dist / f"mbgw-{shop.version}.tar.gz"
        _build(shop, sdist, "--wheel", "--python", python, folder=raw, HATCH_BUILD_HOOK_ENABLE_CUSTOM="1")
        run("auditwheel", "repair", "--wheel-dir", shop.dist, *raw.glob("*.whl"))


def build_debs(shop: Workshop) -> None:
    """Build a Debian package for each kind of machine, with what was compiled for it."""
    if not shutil.which("dh"):
        shop.missing.append("the Debian packages: apt install debhelper python3-pip")
        return
    for machine, architecture in MACHINES.items():
        run(shop.source / "deploy/build-deb", architecture, *compiled_wheels(shop.dist, machine=machine))
        lacking = [python for python in PYTHONS if not compiled_wheels(shop.dist, python=python, machine=machine)]
        if lacking:
            shop.missing.append(f"compiled modules for Python {', '.join(lacking)} in the package for {architecture}")
    for package in (shop.source / "dist").glob("*.deb"):
        shutil.copy(package, shop.dist)


def build_image(shop: Workshop) -> None:
    """Build the container image for all kinds of machine, as one file."""
    file = shop.dist / f"modbus-gateway-{shop.version}.oci.tar"
    run(
        *("docker", "buildx", "build", "--platform", "linux/amd64,linux/arm64,linux/arm/v7"),
        *("--output", f"type=oci,dest={file}", "--file", shop.source / "deploy/Dockerfile", shop.source),
    )


def _build(shop: Workshop, *words: str | Path, folder: Path, **variables: str) -> None:
    """Build with pinned tools; variables go to the build hook."""
    pinned = shop.source / "deploy/requirements-build.txt"
    command = ("uv", "build", "--quiet", "--build-constraints", pinned, "--require-hashes", "--out-dir", folder)
    run(*command, *words, **variables)
