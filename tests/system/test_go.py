"""`./deploy/go`, in a small checkout and with an installer that only notes what it is asked for."""

import os
import re
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from kit.process import PATIENCE

GO = Path(__file__).parents[2] / "deploy/go"
#: As Python and pip are called: `python -m venv FOLDER`, `pip install ... -r FILE`.
PYTHON = f"""#!/bin/sh
[ "$2" = venv ] || exec {sys.executable} "$@"
echo "venv ${{3##*/}}" >> "$CALLS"
{sys.executable} -m venv --without-pip "$3"
cat > "$3/bin/pip" << 'END'
#!/bin/sh
for last; do :; done
echo "pip ${{last##*/}}" >> "$CALLS"
case " $* " in *" --no-deps "*) ;; *) echo "coverage[toml] has no hash"; exit 1 ;; esac # as before 23.3
END
chmod +x "$3/bin/pip"
"""
#: As uv is called: `uv venv ... FOLDER`, `uv pip install ... -r FILE`.
UV = f"""#!/bin/sh
for last; do :; done
echo "$1 ${{last##*/}}" >> "$CALLS"
case $1 in
    venv) exec {sys.executable} -m venv --without-pip --clear "$last" ;;
    pip) [ ! -e "$BROKEN" ] || kill -KILL "$PPID" ;;
esac
"""
NO_PYTHON = "#!/bin/sh\nexit 1\n"
COMPILED = "gateway__mypyc.some-machine.so"
COMPILE = f"import pathlib, sys\npathlib.Path(sys.argv[1], '{COMPILED}').touch()\n"
MAIN = "import gateway, sys\nprint(gateway.__version__, sys.argv[1:])\n"
#: As pytest is called; what is asked of it with these words in it fails.
PYTEST = """#!/bin/sh
echo "tested $*"
case " $* " in *" {failing} "*) echo "FAILED $*"; exit 1 ;; esac
"""
#: Words that only one of the passes of `test` has.
PASSES = [
    "tests --ignore tests/system",
    "no:logging tests/clock",
    "--no-loadscope-reorder tests/system -m not search",
]
#: Those of CI: with searches, and then with compiled modules.
CI_PASSES = [
    *("tests --ignore tests/system", "no:logging tests/clock", "--no-loadscope-reorder tests/system"),
    *("--numprocesses auto tests/clock", "tests/system/test_udp.py"),
]
SET_UP = ["venv .venv", "pip requirements.txt"]
TOOLS = ["pip requirements-dev.txt"]

#: Makes root heed what it must not write.
ORDINARY = [shutil.which("setpriv"), "--bounding-set=-dac_override"] if os.geteuid() == 0 else []


@contextmanager
def no_rights_in(folder: Path) -> Iterator[None]:
    """Nothing can be made or removed in it, nor in what it has."""
    folders = [folder, *(path for path in folder.rglob("*") if path.is_dir())]
    for each in folders:
        each.chmod(0o555)
    yield
    for each in folders:
        each.chmod(0o755)


class Checkout:
    """A checkout whose path has a space in it, and a machine whose programs are those of the system and `programs`."""

    def __init__(self, folder: Path) -> None:
        self.root = folder / "a checkout"
        self.programs = folder / "programs"
        self.broken = folder / "broken"
        self._calls = folder / "calls"
        self._calls.touch()
        self.own = {"PATH": f"{self.programs}:/usr/bin:/bin", "CALLS": str(self._calls), "BROKEN": str(self.broken)}
        self.programs.mkdir()
        for name, text in {
            "gateway/__init__.py": '__version__ = "1"\n',
            "gateway/cli/__init__.py": "",
            "gateway/cli/main.py": MAIN,
            "deploy/requirements.txt": "",
            "deploy/requirements-dev.txt": "",
            "deploy/compile": COMPILE,
            **dict.fromkeys(("tests/kit/programs.py", "tests/kit/system_tree.py", "tests/kit/left_out.py"), ""),
        }.items():
            self.write(name, text)
        shutil.copy(GO, self.root / "deploy/go")
        self.program("uv", UV)
        for python in ("python3", "python3.11", "python3.12", "python3.13", "python3.14"):
            self.program(python, NO_PYTHON)

    def write(self, name: str, text: str) -> None:
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)

    def program(self, name: str, text: str) -> None:
        (self.programs / name).write_text(text)
        (self.programs / name).chmod(0o755)

    def start(self, *words: str) -> subprocess.Popen[str]:
        command = [*ORDINARY, self.root / "deploy/go", *words]
        return subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=self.own)

    def go(self, *words: str) -> tuple[int, str, str]:
        """Exit code, what it prints, what it says of itself."""
        with self.start(*words) as process:
            shown, said = process.communicate(timeout=PATIENCE)
            return process.returncode, shown, said

    def files(self) -> set[Path]:
        return set(self.root.rglob("*"))

    def is_compiled(self) -> bool:
        return any(self.root.rglob(COMPILED))

    def calls(self) -> list[str]:
        """What the installer was asked for since this was last asked."""
        calls = self._calls.read_text().splitlines()
        self._calls.write_text("")
        return calls


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    return Checkout(tmp_path)


def test_who_runs_the_gateway_gets_the_libraries_that_run_it_and_waits_for_no_compiler(checkout: Checkout) -> None:
    assert checkout.go("run", "my file")[:2] == (0, "1 ['run', 'my file']\n")
    assert checkout.calls() == SET_UP
    assert not checkout.is_compiled()


def test_the_second_time_nothing_is_left_to_do(checkout: Checkout) -> None:
    checkout.go()
    checkout.calls()
    assert checkout.go() == (0, "1 []\n", "")
    assert checkout.calls() == []


@pytest.mark.parametrize("name", ["modbus-gateway", "mbgw"])
def test_the_command_is_there_under_both_names(checkout: Checkout, name: str, tmp_path: Path) -> None:
    checkout.go()
    (tmp_path / "gateway").mkdir()  # in the current folder: none of ours
    command = [checkout.root / ".venv/bin" / name]
    assert subprocess.check_output(command, cwd=tmp_path, env=checkout.own, text=True) == "1 []\n"


def test_who_writes_no_byte_code_need_not_compile_at_each_start(checkout: Checkout) -> None:
    checkout.own["PYTHONDONTWRITEBYTECODE"] = "1"
    assert checkout.go()[:2] == (0, "1 []\n")
    (main,) = checkout.root.glob(".venv/lib/python3*/site-packages/gateway/cli/__pycache__/main.*.pyc")
    source = main.parents[1] / "main.py"
    assert int.from_bytes(main.read_bytes()[8:12], "little") == int(source.stat().st_mtime)


def test_a_gateway_that_has_changed_is_installed_and_what_is_gone_is_gone(checkout: Checkout) -> None:
    checkout.write("gateway/old.py", "")
    checkout.go()
    checkout.write("gateway/__init__.py", '__version__ = "2"\n')
    (checkout.root / "gateway/old.py").unlink()
    assert checkout.go()[:2] == (0, "2 []\n")
    assert checkout.calls() == SET_UP
    assert not list(checkout.root.rglob("old.py"))


@pytest.mark.parametrize("name", ["deploy/requirements.txt", "deploy/requirements-dev.txt"])
def test_libraries_that_have_changed_are_installed(checkout: Checkout, name: str) -> None:
    checkout.go("compile")
    assert checkout.calls() == [*SET_UP, *TOOLS]
    checkout.write(name, "# changed\n")
    checkout.go("compile")
    assert checkout.calls() == ([*SET_UP, *TOOLS] if name == "deploy/requirements.txt" else TOOLS)


def test_what_was_broken_off_is_done_again(checkout: Checkout) -> None:
    checkout.broken.touch()
    assert checkout.go()[0] == -signal.SIGKILL
    checkout.broken.unlink()
    checkout.calls()
    assert checkout.go()[:2] == (0, "1 []\n")
    assert checkout.calls() == SET_UP


def test_two_at_once_install_one_after_the_other(checkout: Checkout) -> None:
    with checkout.start("one") as one, checkout.start("two") as two:
        assert one.communicate(timeout=PATIENCE)[0] == "1 ['one']\n"
        assert two.communicate(timeout=PATIENCE)[0] == "1 ['two']\n"
    assert checkout.calls() == SET_UP


def test_it_is_compiled_once_until_it_changes(checkout: Checkout) -> None:
    assert "compiling" in checkout.go("compile")[2]
    assert checkout.is_compiled()
    assert checkout.go("compile") == (0, "", "")
    checkout.write("gateway/__init__.py", '__version__ = "2"\n')
    checkout.go()
    assert not checkout.is_compiled()


@pytest.mark.parametrize("end", ["sys.exit('no compiler')", "os.kill(os.getppid(), 9)"])
def test_what_could_not_be_compiled_runs_all_the_same(checkout: Checkout, end: str) -> None:
    """Half of what was compiled would not: it is installed anew."""
    checkout.write("deploy/compile", f"{COMPILE}import os\n{end}\n")
    status, _, said = checkout.go("compile")
    assert status == (1 if "exit" in end else -signal.SIGKILL)
    assert ("apt install gcc python3-dev); why it failed: " in said) == ("exit" in end)
    assert ("compile.log" in said) == ("exit" in end)
    assert checkout.go()[:2] == (0, "1 []\n")
    assert not checkout.is_compiled()


def test_without_uv_it_is_pip_that_installs(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    checkout.program("python3.12", PYTHON)
    assert checkout.go()[:2] == (0, "1 []\n")
    assert checkout.go("compile")[0] == 0
    assert checkout.calls() == [*SET_UP, *TOOLS]


def test_without_any_python_it_names_the_package_to_install(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    status, shown, said = checkout.go()
    assert (status, shown) == (1, "")
    assert "apt install python3 python3-venv" in said


def test_without_flock_it_names_the_package_to_install(checkout: Checkout) -> None:
    for needed in ("dirname", "readlink"):
        (checkout.programs / needed).symlink_to(shutil.which(needed))
    checkout.own["PATH"] = str(checkout.programs)
    status, shown, said = checkout.go()
    assert (status, shown) == (1, "")
    assert said == "deploy/go: flock is needed and was not found. On Debian: apt install util-linux\n"


@pytest.mark.parametrize("part", [".", ".venv/lib"])
@pytest.mark.parametrize("changed", ["requirements.txt", "requirements-dev.txt", "compile"])
def test_who_must_not_install_is_told_so_once_and_nothing_changes(checkout: Checkout, part: str, changed: str) -> None:
    checkout.go("compile")
    checkout.write(f"deploy/{changed}", "# changed\n")
    before = checkout.files()
    with no_rights_in(checkout.root / part):
        status, shown, said = checkout.go("compile")
    assert (status, shown, said.count("\n")) == (1, "", 1)
    assert "is not yours to write" in said
    assert checkout.files() == before


def test_who_must_not_install_runs_what_is_there(checkout: Checkout) -> None:
    checkout.go()
    with no_rights_in(checkout.root):
        assert checkout.go() == (0, "1 []\n", "")


def test_a_gateway_that_runs_loses_nothing_to_an_installation_that_fails(checkout: Checkout) -> None:
    checkout.go()
    checkout.write("gateway/__init__.py", '__version__ = "2"\n')
    checkout.program("cp", "#!/bin/sh\nexit 1\n")
    assert checkout.go()[0] == 1
    command = checkout.root / ".venv/bin/modbus-gateway"
    assert subprocess.check_output([command], env=checkout.own, text=True) == "1 []\n"
    (checkout.programs / "cp").unlink()
    assert checkout.go()[:2] == (0, "2 []\n")


def test_what_uv_has_made_needs_uv_for_more_and_runs_without(checkout: Checkout) -> None:
    checkout.go()
    (checkout.programs / "uv").unlink()
    assert checkout.go() == (0, "1 []\n", "")
    assert "with uv in the PATH" in checkout.go("compile")[2]


def with_tools(checkout: Checkout, failing: str = "nothing") -> Checkout:
    for name in ("ruff", "mypy", "lint-imports"):
        checkout.program(name, "#!/bin/sh\n")
    checkout.program("pytest", PYTEST.format(failing=failing))
    return checkout


@pytest.mark.parametrize(("own", "passes"), [({}, PASSES), ({"CI": "true"}, CI_PASSES)], ids=["own", "CI"])
def test_everything_is_tested_as_it_is_and_by_ci_compiled(checkout: Checkout, own, passes: list[str]) -> None:
    checkout.own |= own
    status, shown, said = with_tools(checkout).go("test")
    assert status == 0
    tested = [f"{line} " for line in shown.splitlines() if line.startswith("tested ")]
    assert all(any(f" {words} " in line for line in tested) for words in passes)
    assert len(tested) == len(passes)
    assert ("not in this run" in said) == (passes == PASSES)
    assert checkout.is_compiled() == (passes != PASSES)


@pytest.mark.parametrize(
    ("own", "words"),
    [*(({}, words) for words in PASSES), *(({"CI": "true"}, words) for words in CI_PASSES)],
    ids=str,
)
def test_a_pass_that_fails_fails_the_whole_and_is_shown(checkout: Checkout, own, words: str) -> None:
    checkout.own |= own
    status, shown, _ = with_tools(checkout, failing=words).go("test")
    assert status == 1
    assert shown.count("FAILED") == 1


@pytest.mark.parametrize("tool", ["ruff", "mypy", "lint-imports"])
def test_a_check_that_fails_is_a_failure(checkout: Checkout, tool: str) -> None:
    with_tools(checkout).program(tool, "#!/bin/sh\nexit 3\n")
    assert checkout.go("test")[0] == 3


def test_ci_needs_a_compiler(checkout: Checkout) -> None:
    with_tools(checkout).write("deploy/compile", "import sys\nsys.exit('no compiler')\n")
    checkout.own["CI"] = "true"
    assert checkout.go("test")[0] == 1


def test_what_it_names_is_there() -> None:
    """pytest says nothing when what it shall ignore is not."""
    named = re.findall(r"tests(?:/[\w.]+)+", GO.read_text())
    assert named
    assert [path for path in named if not (GO.parents[1] / path).exists()] == []
