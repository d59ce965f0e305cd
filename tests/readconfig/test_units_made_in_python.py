"""Units made in Python in a config that is read by a process of its own."""

import os
import resource
import signal
import sys
from contextlib import suppress
from pathlib import Path

import pytest

from gateway.errors import ConfigError
from gateway.readconfig.process import ConfigProcess, read_config
from gateway.readconfig.text_check import check_text
from kit.process import PATIENCE

CONFIG = '[[image]]\nunit = 60\npython = "clock_p:Clock"\n'
CLOCK = """\
from gateway import CustomUnit

class Clock(CustomUnit):
    async def read(self, area, address, count):
        return [1] * count
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    file = tmp_path / "gateway.toml"
    file.write_text(CONFIG)
    return file


def write(file: Path, text: str = CLOCK) -> None:
    (file.parent / "clock_p.py").write_text(text)


def test_the_class_beside_the_config_is_imported_there_and_not_here(file):
    write(file)
    read = read_config(file)
    assert (read.plan.images[0].python, read.errors) == ("clock_p:Clock", ())
    assert "clock_p" not in sys.modules
    assert str(file.parent) not in sys.path


def test_the_folder_is_that_of_the_config_wherever_the_process_works(file, monkeypatch):
    write(file)
    monkeypatch.chdir(file.parent)
    assert read_config(Path("gateway.toml")).errors == ()
    monkeypatch.chdir("/")
    assert read_config(file).errors == ()


def test_a_changed_module_is_read_anew_each_time(file):
    write(file)
    assert read_config(file).errors == ()
    write(file, CLOCK.replace("Clock", "Uhr"))
    assert "clock_p has no class Clock" in read_config(file).errors[0]


def test_its_prints_are_not_taken_for_the_answer(file):
    write(file, f"print('hello', flush=True)\n{CLOCK}")
    assert read_config(file).errors == ()


@pytest.mark.parametrize("look_around", [False, True])
def test_what_is_wrong_with_it_is_an_error_in_its_line(file, look_around):
    write(file, "1 / 0\n")
    [error] = read_config(file, look_around=look_around).errors
    folder = file.parent
    assert error == (
        f"{file}:3:10: error: image[0].python: clock_p cannot be imported: ZeroDivisionError: division by zero "
        f"({folder}/clock_p.py, line 1)"
    )


def test_in_a_text_it_is_not_imported_and_that_is_said(file):
    write(file, f"open({str(file.parent / 'was-imported')!r}, 'w')\n{CLOCK}")
    checked = check_text(file, CONFIG, CONFIG)
    assert (checked.problems, checked.notes[-1]) == ((), "not imported: clock_p:Clock")
    assert not (file.parent / "was-imported").exists()
    assert "not imported" not in str(check_text(file, "[[image]]\nunit = 1\ncoils = 1\n", CONFIG).notes)


def test_code_that_all_users_may_change_is_warned_of(file):
    write(file)
    assert read_config(file, look_around=True).problems == ()
    module, folder = file.parent / "clock_p.py", file.parent
    for place, mode in ((folder, 0o777), (module, 0o666)):
        place.chmod(mode)
        [warning] = map(str, read_config(file, look_around=True).problems)
        assert warning == (
            f"{file}:3:10: warning: image[0].python: all users may change {place}, and with it what the gateway does\n"
            f"  help: chmod o-w {place}"
        )


@pytest.mark.parametrize(
    "more",
    [
        "import os\nos.write(1, b'hello')",
        "import subprocess\nsubprocess.run(['echo', 'hello'])",
        "import os\nos.close(2)",
        "import sys\nsys.stdout = sys.stderr = None",
        f"import os\nif os.fork() == 0:\n    __import__('time').sleep({PATIENCE})\n    os._exit(0)",
        f"import subprocess\nsubprocess.Popen(['sleep', '{PATIENCE}'])",
        f"import threading, time\nthreading.Thread(target=time.sleep, args=({PATIENCE},)).start()",
        "import os\nos.chdir('/')",
    ],
)
def test_what_else_it_does_keeps_no_answer_from_coming(file, more):
    """An answer that waits for what takes longer than READING_TIME does not come at all."""
    write(file, f"{more}\n{CLOCK}")
    reading = ConfigProcess(file)
    try:
        assert reading.result().errors == ()
    finally:
        with suppress(ProcessLookupError):  # of most of these nothing is left
            os.killpg(reading._process._process.pid, signal.SIGKILL)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise BaseException('no')", "clock_p:Clock cannot be used: BaseException: no"),
        ("raise KeyboardInterrupt", "clock_p:Clock cannot be imported and made: KeyboardInterrupt"),
        ("class E(Exception):\n    __str__ = None\nraise E", "clock_p cannot be imported: E: <exception str() failed>"),
        ("def __getattr__(name):\n    raise ValueError(name)", "clock_p:Clock cannot be used: ValueError: Clock"),
        ("import sys\nsys.modules[__name__] = 42", "clock_p:Clock cannot be used: TypeError: vars()"),
        (f"{CLOCK}    read.__wrapped__ = read", "clock_p:Clock cannot be used: ValueError: wrapper loop"),
    ],
)
def test_whatever_it_raises_is_an_error_in_its_line(file, text, said):
    write(file, text)
    [error] = read_config(file).errors
    assert error.startswith(f"{file}:3:10: error: image[0].python: {said}")


def test_a_class_may_have_a_second_base_that_does_not_say_what_it_takes(file):
    write(file, CLOCK.replace("CustomUnit)", "CustomUnit, dict)"))
    assert read_config(file).errors == ()


def test_one_that_ends_the_process_is_not_taken_for_a_newer_gateway(file):
    write(file, "import os\nos._exit(0)")
    with pytest.raises(ConfigError, match="has ended without an answer"):
        read_config(file)


def test_prints_without_end_take_no_memory_here(file):
    write(file, "import os\nfor _ in range(500):\n    os.write(2, b'x' * 10**6)\nraise SystemExit('enough')")
    before = memory()
    [error] = read_config(file).errors
    assert "SystemExit: enough" in error
    assert memory() - before < 100_000


def memory() -> int:
    """The most memory that this process has had, in KiB."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
