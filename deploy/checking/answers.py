"""Whether a wheel can be installed where nothing else is, and the gateway in it answers."""

import subprocess
import tempfile
from pathlib import Path

from checking.findings import Findings
from releasing.commands import output
from releasing.kinds import is_pure


def check_answer(findings: Findings, wheel: Path, python: str) -> None:
    """Install it on this Python, and have the demo ask every device."""
    with tempfile.TemporaryDirectory(prefix="check-release.") as folder:
        programs = Path(folder, "environment/bin")
        commands: list[list[str | Path]] = [
            ["uv", "venv", "--quiet", "--python", python, programs.parent],
            ["uv", "pip", "install", "--quiet", "--python", programs / "python", wheel],
            [programs / "mbgw", "demo", "--once"],
        ]
        for command in commands:
            done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=folder)
            if done.returncode:
                findings.expect(is_right=False, what=f"{wheel.name}, {command}: {done.stderr or done.stdout}")
                return
        print(f"{wheel.name} on {python}: {done.stdout.splitlines()[-1]}")
        program = "import gateway.lines.line as line; print(line.__file__)"
        where = output(programs / "python", "-c", program, folder=Path(folder))
        findings.expect(where.endswith(".py" if is_pure(wheel) else ".so"), f"{wheel.name}: runs {where}")
