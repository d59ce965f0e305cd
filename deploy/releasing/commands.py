"""Calls of other programs."""

import os
import subprocess
import sys
from pathlib import Path


def run(*words: str | Path, **variables: str) -> None:
    """Run a command, shown; a failure of it is the end."""
    print("$", *words, flush=True)
    if subprocess.run(words, env=os.environ | variables, check=False).returncode:
        sys.exit(f"deploy/release: {Path(words[0]).name} has failed")


def output(*words: str | Path, folder: Path | None = None) -> str:
    """What a command prints; nothing if it fails or is not there."""
    try:
        done = subprocess.run(
            words, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, check=False, cwd=folder
        )
    except FileNotFoundError:
        return ""
    return "" if done.returncode else done.stdout.strip()


def python_here(version: str) -> str:
    """The interpreter of this version that uv finds or brings; nothing if there is none."""
    return output("uv", "python", "find", version) or (
        output("uv", "python", "install", version) and output("uv", "python", "find", version)
    )
