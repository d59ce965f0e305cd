"""What a developer does, by name: `nox -l` lists it, and `nox -s NAME -- WORDS` does one of it.

All use .venv, and bring it up to date with uv.lock; `lowest` and `pythons` make environments of their own. Without
uv and nox, `./deploy/go test` sets up both in .venv/bin.
"""

import ast
import functools
import os
from collections.abc import Callable
from pathlib import Path
from typing import Final

import nox

ROOT: Final = Path(__file__).parent
PYTHONS: Final = ("3.11", "3.12", "3.13", "3.14")
#: What meets a library, each at least once.
LOWEST: Final = ("tests/observe", "tests/ports", "tests/fleet/test_connection.py", "tests/system/test_demo.py")
#: What is generated, and the command that prints it, or writes it itself.
PRINTED: Final = {
    "docs/configuration.md": "-m gateway.config.documents.reference",
    "docs/own-registers.md": "-m gateway.images.self_map",
    "gateway/web/api/openapi.json": "-m gateway.web.api.document",
    "gateway/web/pages/static/config-keys.json": "-m gateway.config.documents.completion",
    "tests/library/public.txt": "tests/library/public_names.py",
}
WRITTEN: Final = {
    "deploy/man": "-m deploy.command_files",
    "gateway/cli/completions": "-m deploy.command_files",
    "docs/profiles": "-m gateway.config.documents.profile_pages",
}
EXPORT: Final = ("uv", "export", "--quiet", "--frozen", "--no-emit-project", "--no-annotate", "--no-default-groups")
#: What pip installs where there is no uv: the libraries that run the gateway, and uv itself.
EXPORTED: Final = {
    "deploy/requirements.txt": ("--all-extras",),
    "deploy/requirements-uv.txt": ("--only-group", "uv"),
}

nox.options.default_venv_backend = "none"
nox.options.sessions = ["lint", "types", "tests"]
os.environ["PATH"] = f"{ROOT / '.venv/bin'}{os.pathsep}{os.environ['PATH']}"
os.environ["PYTHONPATH"] = str(ROOT)


def session(function: Callable[[nox.Session], None]) -> Callable[[nox.Session], None]:
    """Make a session of it that finds all tools in .venv."""

    @functools.wraps(function)
    def with_tools(session: nox.Session) -> None:
        session.run_install("uv", "sync", "--quiet", "--frozen", "--inexact", "--all-extras", external=True)
        function(session)

    return nox.session(with_tools)


@session
def lint(session: nox.Session) -> None:
    """Style, layout of the code, and that imports go down only."""
    session.run("ruff", "check", *session.posargs)
    session.run("ruff", "format", "--check", *session.posargs)
    session.run("lint-imports")


@session
def types(session: nox.Session) -> None:
    """Types of the gateway and of the examples of the docs."""
    session.run("mypy")
    session.run("mypy", "docs/examples")


@session
def tests(session: nox.Session) -> None:
    """All tests, or those that the words choose: -- tests/lines -k silence."""
    session.run("pytest", *(session.posargs or ("-m", "not search")))


@session
def docs(session: nox.Session) -> None:
    """A site of docs/ in dist/site; -- linkcheck tries the links that lead elsewhere."""
    builder = (*session.posargs, "html")[0]
    session.run("sphinx-build", "--quiet", "--fail-on-warning", "--keep-going", "-b", builder, "docs", "dist/site")


@session
def gen(session: nox.Session) -> None:
    """Make all that is generated: uv.lock, what pip installs, reference, manual, completions, profiles."""
    generate(session)


@session
def stale(session: nox.Session) -> None:
    """Make it, and fail if something was not current."""
    before = generated()
    generate(session)
    changed = [str(path) for path, content in generated().items() if before.get(path) != content]
    if changed:
        session.error(f"not current, and made anew: {', '.join(changed)}")


def generate(session: nox.Session) -> None:
    """Write each file that is generated."""
    session.run("python", "deploy/addresses.py")
    session.run("uv", "lock", "--quiet")
    for path, words in EXPORTED.items():
        session.run(*EXPORT, *words, "--output-file", path, silent=True)
    for path, words in PRINTED.items():
        printed = session.run("python", *words.split(), silent=True, stderr=None)
        (ROOT / path).write_text(str(printed), encoding="utf-8")
    for words in dict.fromkeys(WRITTEN.values()):
        session.run("python", *words.split())


def generated() -> dict[Path, bytes]:
    """Return the content of each file that is generated."""
    named = [Path(path) for path in ("uv.lock", *EXPORTED, *PRINTED, *WRITTEN)]
    files = (file for path in named for file in (path.rglob("*") if path.is_dir() else [path]))
    return {file: file.read_bytes() for file in files if file.is_file()}


@session
def audit(session: nox.Session) -> None:
    """Weak code (bandit), and known weaknesses of the libraries (pip-audit)."""
    session.run("bandit", "--quiet", "--configfile", "pyproject.toml", "--recursive", "gateway")
    session.run("pip-audit", "--disable-pip", "--require-hashes", "--requirement", "deploy/requirements.txt")


@nox.session(venv_backend="uv")
def lowest(session: nox.Session) -> None:
    """Tests with the oldest libraries that pyproject.toml allows."""
    session.install(
        "--resolution", "lowest-direct", "--all-extras", "--requirement", "pyproject.toml", "--group", "test"
    )
    session.run("pytest", *(session.posargs or LOWEST))


@nox.session(venv_backend="uv", python=PYTHONS)
def pythons(session: nox.Session) -> None:
    """Tests in virtual time on each Python, with the newest libraries."""
    session.install("--upgrade", "--all-extras", "--requirement", "pyproject.toml", "--group", "test")
    session.run("pytest", *(session.posargs or ("tests", "--ignore", "tests/system", "-m", "not search")))


@session
def soak(session: nox.Session) -> None:
    """A slow check by its name: -- kill --rounds 500; without a name, the list."""
    script(session, "tests/soak")


@session
def bench(session: nox.Session) -> None:
    """A benchmark by its name: -- growth --check; without a name, the list."""
    script(session, "tests/bench")


@session
def model(session: nox.Session) -> None:
    """A search through orders of events by its name: -- every_order --depth 4."""
    script(session, "tests/model")


@session
def qemu(session: nox.Session) -> None:
    """A check in an emulated machine by its name: -- uart 8250."""
    script(session, "tests/qemu")


def script(session: nox.Session, folder: str) -> None:
    """Run the script that is named, or list all of a folder."""
    if session.posargs:
        name, *words = session.posargs
        session.run("python", f"{folder}/{name}.py", *words)
        return
    for file in sorted(Path(folder).glob("*.py")):
        text = file.read_text(encoding="utf-8")
        if '__name__ == "__main__"' in text:
            session.log(f"{file.stem:16} {str(ast.get_docstring(ast.parse(text))).partition(chr(10))[0]}")
