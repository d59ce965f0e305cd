"""`./deploy/go`, in a small checkout and with installers that only note what they are asked for."""

import os
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
#: As Python and pip are called: `python -m venv --clear FOLDER`, and there `python -m pip install ... -r FILE`.
PYTHON = f"""#!/bin/sh
[ "$2" = venv ] || exec {sys.executable} "$@"
for last; do :; done
echo "venv ${{last##*/}}" >> "$CALLS"
{sys.executable} "$@" --without-pip
mkdir -p "$last"/lib/python3.{sys.version_info.minor}/site-packages/pip
cp "$PIP" "$last"/lib/python3.{sys.version_info.minor}/site-packages/pip/__main__.py
"""
PIP = """
import os, pathlib, sys
if "--version" not in sys.argv:
    file = pathlib.Path(sys.argv[-1]).name
    with open(os.environ["CALLS"], "a") as calls:
        print("pip", file, file=calls)
    assert {"--no-deps", "--require-hashes"} <= set(sys.argv)
    if file == "requirements-uv.txt":
        uv = pathlib.Path(sys.executable).with_name("uv")
        uv.write_text(os.environ["UV"])
        uv.chmod(0o755)
"""
#: As uv is called: `uv sync --project FOLDER ...`. The tools are nox.
UV = f"""#!/bin/sh
case " $* " in *" --no-dev "*) what=libraries ;; *) what=tools ;; esac
echo "uv $1 $what" >> "$CALLS"
[ ! -e "$BROKEN" ] || kill -KILL "$PPID"
[ -e "$UV_PROJECT_ENVIRONMENT" ] || {sys.executable} -m venv --without-pip "$UV_PROJECT_ENVIRONMENT"
grep -q ^uv "$UV_PROJECT_ENVIRONMENT/pyvenv.cfg" || echo "uv = 1" >> "$UV_PROJECT_ENVIRONMENT/pyvenv.cfg"
[ "$what" = libraries ] || printf '#!/bin/sh\necho "nox $*"\n[ ! -e "$BROKEN" ]\n' > "$UV_PROJECT_ENVIRONMENT/bin/nox"
[ "$what" = libraries ] || chmod +x "$UV_PROJECT_ENVIRONMENT/bin/nox"
"""
NO_PYTHON = "#!/bin/sh\nexit 1\n"
COMPILED = "gateway__mypyc.some-machine.so"
COMPILE = f"import pathlib, sys\npathlib.Path(sys.argv[1], '{COMPILED}').touch()\n"
MAIN = "import gateway, sys\nprint(gateway.__version__, sys.argv[1:])\n"
SET_UP = ["uv sync libraries"]
TOOLS = ["uv sync tools"]

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
        (folder / "pip.py").write_text(PIP)
        self.own = {
            "PATH": f"{self.programs}:/usr/bin:/bin",
            "CALLS": str(self._calls),
            "BROKEN": str(self.broken),
            "PIP": str(folder / "pip.py"),
            "UV": UV,
        }
        self.programs.mkdir()
        for name, text in {
            "gateway/__init__.py": '__version__ = "1"\n',
            "gateway/cli/__init__.py": "",
            "gateway/cli/main.py": MAIN,
            "uv.lock": "",
            "deploy/compile": COMPILE,
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


def test_libraries_and_tools_are_installed_when_they_have_changed(checkout: Checkout) -> None:
    checkout.go("compile")
    assert checkout.calls() == [*SET_UP, *TOOLS]
    checkout.write("uv.lock", "# changed\n")
    checkout.go("compile")
    assert checkout.calls() == [*SET_UP, *TOOLS]


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
    assert ("no compiler" in said) == ("apt install gcc python3-dev)" in said) == ("exit" in end)
    assert checkout.go()[:2] == (0, "1 []\n")
    assert not checkout.is_compiled()


def test_without_uv_it_is_pip_that_installs(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    checkout.program("python3.12", PYTHON)
    assert checkout.go()[:2] == (0, "1 []\n")
    assert checkout.calls() == ["venv .venv", "pip requirements.txt"]


def test_without_uv_pip_installs_the_one_that_brings_the_tools(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    checkout.program("python3.12", PYTHON)
    assert checkout.go("compile")[0] == 0
    assert checkout.calls() == ["venv .venv", "pip requirements.txt", "pip requirements-uv.txt", *TOOLS]
    checkout.write("uv.lock", "# changed\n")
    checkout.go("compile")
    assert checkout.calls() == ["pip requirements.txt", *TOOLS]


def test_what_pip_has_begun_is_begun_again(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    checkout.program("python3.12", PYTHON)
    checkout.write(".venv/bin/python", "")
    assert checkout.go()[:2] == (0, "1 []\n")
    assert checkout.calls() == ["venv .venv", "pip requirements.txt"]


def test_without_any_python_it_names_the_package_to_install(checkout: Checkout) -> None:
    (checkout.programs / "uv").unlink()
    status, shown, said = checkout.go()
    assert (status, shown) == (1, "")
    assert "apt install python3 python3-venv" in said


def test_a_32_bit_system_on_a_64_bit_arm_gets_the_libraries_that_it_can_run(checkout: Checkout) -> None:
    checkout.program("uname", "echo aarch64")
    checkout.program("getconf", "echo 32")
    checkout.program("linux32", 'echo "$_PYTHON_HOST_PLATFORM $2"')
    assert checkout.go("demo")[:2] == (0, "linux-armv7l demo\n")


def test_without_flock_it_names_the_package_to_install(checkout: Checkout) -> None:
    for needed in ("dirname", "getconf", "readlink", "uname"):
        (checkout.programs / needed).symlink_to(shutil.which(needed))
    checkout.own["PATH"] = str(checkout.programs)
    status, shown, said = checkout.go()
    assert (status, shown) == (1, "")
    assert said == "deploy/go: flock is needed and was not found. On Debian: apt install util-linux\n"


@pytest.mark.parametrize("part", [".", ".venv/lib"])
@pytest.mark.parametrize("changed", ["uv.lock", "deploy/compile"])
def test_who_must_not_install_is_told_so_once_and_nothing_changes(checkout: Checkout, part: str, changed: str) -> None:
    checkout.go("compile")
    checkout.write(changed, "# changed\n")
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


@pytest.mark.parametrize(("words", "session"), [(["test", "my test"], "check -- my test"), (["docs"], "docs --")])
def test_what_a_developer_does_is_a_session_of_nox(checkout: Checkout, words: list[str], session: str) -> None:
    status, shown, _ = checkout.go(*words)
    assert (status, shown) == (0, f"nox --noxfile {checkout.root}/noxfile.py --session {session}\n")
    checkout.broken.touch()
    assert checkout.go(*words)[0] == 1
