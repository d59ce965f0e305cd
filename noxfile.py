"""What a developer does, by name: `nox -l` lists it, and `nox -s NAME -- WORDS` does one of it.

All of it uses .venv, and brings that up to date with uv.lock first; `lowest` and `pythons` make environments of their
own. Without uv and nox, `./deploy/go test` puts both into .venv/bin.
"""

import ast
import functools
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Final

import nox

ROOT: Final = Path(__file__).parent
VENV: Final = ROOT / ".venv"
sys.path.insert(0, str(ROOT / "tests"))

from kit import passes  # noqa: E402 - found there
from kit.side_by_side import side_by_side  # noqa: E402

#: What is generated, and what prints it. Not tests/library/public.txt: a change there is decided, not generated.
PRINTED: Final = {
    "docs/configuration.md": "-m deploy.reference",
    "docs/own-registers.md": "-m gateway.images.self_map",
    "gateway/web/api/openapi.json": "-m deploy.api_document",
    "gateway/web/pages/static/config-keys.json": "-m deploy.config_keys",
}
#: What writes its files itself: completions, pages of the profiles, translations of the pages.
WRITE: Final = (
    "-m deploy.completions",
    "-m deploy.profile_pages",
    "-m deploy.translations",
)
#: What of these has types.
GENERATORS: Final = ("api_document", "api_schemas", "config_keys", "profile_pages", "reference")
EXPORT: Final = ("uv", "export", "--quiet", "--frozen", "--no-emit-project", "--no-annotate", "--no-default-groups")
#: What pip installs where there is no uv: the libraries that run the gateway, and uv itself.
EXPORTED: Final = {
    "deploy/requirements.txt": ("--all-extras",),
    "deploy/requirements-uv.txt": ("--only-group", "uv"),
}
MUSL: Final = ("x86_64-unknown-linux-musl", "aarch64-unknown-linux-musl")
LIBRARIES: Final = ("--all-extras", "--requirement", "pyproject.toml")
PYTHONS: Final = ("3.11", "3.12", "3.13", "3.14")

nox.needs_version = ">=2026.4"
nox.options.default_venv_backend = "none"
nox.options.sessions = ["check"]
nox.options.error_on_missing_interpreters = False
os.environ["PATH"] = f"{VENV / 'bin'}{os.pathsep}{os.environ['PATH']}"
os.environ["PYTHONPYCACHEPREFIX"] = str(VENV / "bytecode")
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)  # hundreds of processes start

Action = Callable[[nox.Session], None]


def in_venv(action: Action) -> Action:
    """Make a session of it that has the tools of .venv."""

    @functools.wraps(action)
    def session(session: nox.Session) -> None:
        session.run_install("uv", "sync", "--quiet", "--frozen", "--inexact", "--all-extras")
        action(session)

    return nox.session(session)


@in_venv
def check(session: nox.Session) -> None:
    """All that a change must pass: lint, types and tests, side by side; with CI=true, that of CI."""
    if session.posargs:
        for each in (_lint, _types, _tests):
            each(session)
    elif os.environ.get("CI"):
        run_all(session, passes.of_ci())
    else:
        run_all(session, passes.of_check())
        session.log("not in this run: searches, compiled modules and the rest of CI; CI=true runs them too")


@in_venv
def lint(session: nox.Session) -> None:
    """Style, layout of the code, and that imports go down only."""
    _lint(session)


@in_venv
def types(session: nox.Session) -> None:
    """Types of the gateway and of the examples of the docs."""
    _types(session)


@in_venv
def tests(session: nox.Session) -> None:
    """All tests, side by side, or those that the words choose: -- tests/lines -k silence."""
    _tests(session)


def _lint(session: nox.Session) -> None:
    session.run("ruff", "check")
    session.run("ruff", "format", "--check")
    session.run("lint-imports", env={"PYTHONPATH": str(ROOT)})


def _types(session: nox.Session) -> None:
    session.run("mypy")
    session.run("mypy", "docs/examples")
    session.run("mypy", *(f"--module=deploy.{name}" for name in GENERATORS))


def _tests(session: nox.Session) -> None:
    if session.posargs:
        session.run("pytest", *session.posargs)
    else:
        run_all(session, passes.of_tests())


def run_all(session: nox.Session, jobs: list[passes.Job]) -> None:
    """Run all jobs, and say which have failed, and which tests were left out."""
    session.run("python", "tests/kit/programs.py", "--install")
    passes.LEFT_OUT.unlink(missing_ok=True)
    failed = side_by_side(jobs, VENV / "logs")
    session.run("python", "tests/kit/left_out.py", str(passes.LEFT_OUT), log=False)
    if failed:
        session.error(f"failed, or not run: {', '.join(failed)}")


@in_venv
def docs(session: nox.Session) -> None:
    """A site of docs/ in dist/site, whose search finds; -- linkcheck tries the links that lead elsewhere."""
    builder = (*session.posargs, "html")[0]
    session.run("sphinx-build", "--quiet", "--fail-on-warning", "--keep-going", "-b", builder, "docs", "dist/site")
    if builder == "html" and shutil.which("node"):
        session.run("node", "tests/docs/first_hits.js", "dist/site", external=True)
    session.log("the site is dist/site")


@in_venv
def gen(session: nox.Session) -> None:
    """Make all that is generated: uv.lock, what pip installs, reference, completions, profiles."""
    session.run("python", "deploy/addresses.py")
    generate(session, ROOT)


@in_venv
def stale(session: nox.Session) -> None:
    """Fail if something that is generated is not current: in a copy it is made anew."""
    session.run("python", "deploy/addresses.py", "--check")
    copy = Path(session.create_tmp()).resolve() / "checkout"
    shutil.rmtree(copy, ignore_errors=True)
    shutil.copytree(ROOT, copy, ignore=shutil.ignore_patterns(".*", "dist", "build", "__pycache__"))
    generate(session, copy)
    made = [file.relative_to(copy) for file in sorted(copy.rglob("*")) if file.is_file()]
    if changed := [str(each) for each in made if not is_current(each, copy)]:
        session.error(f"not current, `nox -s gen` makes it: {', '.join(changed)}")


def is_current(file: Path, copy: Path) -> bool:
    """Tell whether a file of the copy is as it is in the checkout."""
    return (ROOT / file).is_file() and (ROOT / file).read_bytes() == (copy / file).read_bytes()


def generate(session: nox.Session, root: Path) -> None:
    """Write each file that is generated in a checkout."""
    own = {"PYTHONPATH": str(root)}
    with session.chdir(root):
        session.run("uv", "lock", "--quiet")
        for path, words in EXPORTED.items():
            session.run(*EXPORT, *words, "--output-file", path, silent=True)
        for path, text in PRINTED.items():
            printed = session.run("python", *text.split(), env=own, silent=True, stderr=None)
            (root / path).write_text(str(printed), encoding="utf-8")
        for text in WRITE:
            session.run("python", *text.split(), env=own)


@in_venv
def audit(session: nox.Session) -> None:
    """Weak code (bandit), known weaknesses of the libraries (pip-audit), and whether all have wheels for musl."""
    session.run("bandit", "--quiet", "--configfile", "pyproject.toml", "--recursive", "gateway")
    pinned = ("--require-hashes", "--requirement", "deploy/requirements.txt")
    session.run("pip-audit", "--disable-pip", *pinned)
    for platform in MUSL:
        session.run(
            *("uv", "pip", "install", "--quiet", "--dry-run", "--only-binary", ":all:"),
            *("--target", session.create_tmp(), "--python-platform", platform, *pinned),
        )


@nox.session(venv_backend="uv")
def lowest(session: nox.Session) -> None:
    """Tests that meet a library, with the oldest ones that pyproject.toml allows."""
    install(session, *LIBRARIES, "--resolution", "lowest-direct")
    session.run("pytest", "--quiet", *(session.posargs or passes.LOWEST))


@nox.session(venv_backend="uv", python=PYTHONS)
def pythons(session: nox.Session) -> None:
    """Tests in virtual time with newest libraries, compiled, and with oldest ones; -- compiled: only that."""
    for kind in session.posargs or ("newest", "compiled", "lowest"):
        install(session, *LIBRARIES, "--upgrade", "--resolution", "lowest-direct" if kind == "lowest" else "highest")
        if kind == "compiled":
            (site,) = Path(session.virtualenv.location).glob("lib/python3*/site-packages")
            shutil.copytree(ROOT / "gateway", site / "gateway", ignore=shutil.ignore_patterns("__pycache__"))
            session.run("python", "deploy/compile", str(site))
        chosen = {"newest": passes.VIRTUAL, "compiled": passes.COMPILED, "lowest": passes.LOWEST}[kind]
        session.run("pytest", "--quiet", "--numprocesses", "auto", *chosen)


def install(session: nox.Session, *words: str) -> None:
    """Install libraries, and beside them what tests and compiles, as it is pinned."""
    tools = Path(session.virtualenv.location) / "tools.txt"
    session.run(*EXPORT, "--no-hashes", "--only-group", "test", "--only-group", "build", "-o", str(tools), silent=True)
    session.install("--requirement", str(tools))
    session.install("--only-binary", ":all:", *words)


@in_venv
def soak(session: nox.Session) -> None:
    """Slow checks by their names: -- kill --rounds 500; without a name, the list."""
    script(session, "tests/soak")


@in_venv
def bench(session: nox.Session) -> None:
    """Benchmarks: -- growth --check."""
    script(session, "tests/bench")


@in_venv
def model(session: nox.Session) -> None:
    """Searches through the orders of events: -- every_order --depth 4."""
    script(session, "tests/model")


@in_venv
def mutation(session: nox.Session) -> None:
    """Whether tests notice what is changed in the code: -- mutants --sample 300 --quick."""
    session.run("uv", "pip", "install", "--quiet", "cosmic-ray")
    script(session, "tests/mutation")


@in_venv
def qemu(session: nox.Session) -> None:
    """Machines that are emulated: -- uart 8250."""
    script(session, "tests/qemu")


def script(session: nox.Session, folder: str) -> None:
    """Run the script that is named with the gateway as it is now, or list all of a folder."""
    if session.posargs:
        name, *words = session.posargs
        session.run("deploy/go", "--version", silent=True, external=True)  # installs it
        session.run("python", f"{folder}/{name}.py", *words)
        return
    for file in sorted(Path(folder).glob("*.py")):
        text = file.read_text(encoding="utf-8")
        if '__name__ == "__main__"' in text:
            session.log(f"{file.stem:16} {str(ast.get_docstring(ast.parse(text))).partition(chr(10))[0]}")
