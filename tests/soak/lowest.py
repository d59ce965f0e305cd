"""The gateway with the oldest libraries that pyproject.toml allows: those tests that meet them must pass.

    .venv/bin/python tests/soak/lowest.py

It makes an environment of its own, with this Python, whose libraries go before those of this one; what tests is the
same. It leaves nothing behind. Arguments go to pytest, in place of the tests that are chosen here.
"""

import os
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from pathlib import Path

from packaging.requirements import Requirement

CHECKOUT = Path(__file__).resolve().parents[2]
#: Whatever imports a library, and the whole gateway once. Of the web page and the fleet only what meets its library.
TESTS = (
    *(f"tests/{each}" for each in ("cli", "config", "modbus", "observe", "oracle", "plant", "ports")),
    *(f"tests/fleet/test_{each}.py" for each in ("bucket", "connection", "serving")),
    *(
        f"tests/web/{each}.py"
        for each in (
            "access/test_access",
            "api/test_api",
            "front/test_connections",
            "front/test_hostile_requests",
            "front/test_streams",
            "pages/test_writing",
        )
    ),
)
REAL_TIME = tuple(
    f"tests/system/test_{each}.py" for each in ("demo", "fleet_connection", "mqtt_connection", "serial_pty", "web")
)


def lowest(text: str) -> str:
    """The lowest version that a requirement allows: `pyserial==3.5` for `pyserial>=3.5`."""
    library = Requirement(text)
    (version,) = (one.version for one in library.specifier if one.operator in {">=", "=="})
    return f"{library.name}=={version}"


def main(tests: list[str]) -> int:
    """Install them, and run the tests; pytest's exit code."""
    project = tomllib.loads((CHECKOUT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = (each for texts in project["optional-dependencies"].values() for each in texts)
    wanted = [lowest(each) for each in (*project["dependencies"], *extras)]
    print("with", *wanted, flush=True)
    with tempfile.TemporaryDirectory(prefix="lowest.") as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        python = f"{folder}/bin/python"
        pip = [python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--only-binary", ":all:"]
        pip += ["--no-compile"]
        look_here_too(python)  # what is pinned there is installed again only where the oldest need another version
        subprocess.run([*pip, *wanted], check=True)
        pytest = [python, "-m", "pytest", "--quiet", "--numprocesses", "auto", "--dist", "loadfile"]
        # Many cases of ours meet no library in another way than a few.
        pytest += ["-m", "not search", "--hypothesis-profile=quick"]
        own = os.environ | {"PYTHONPYCACHEPREFIX": str(Path(sys.prefix, "bytecode"))}
        own.pop("PYTHONDONTWRITEBYTECODE", None)  # hundreds of processes start
        chosen = tests or (*TESTS, *REAL_TIME)
        return subprocess.run([*pytest, *chosen], cwd=CHECKOUT, env=own, check=False).returncode


def look_here_too(python: str) -> None:
    """Let another environment find what is installed in this one and not in its own."""
    where = "import sysconfig; print(sysconfig.get_path('purelib'))"
    folder = subprocess.check_output([python, "-c", where], text=True).strip()
    Path(folder, "tools.pth").write_text(sysconfig.get_path("purelib"), encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
