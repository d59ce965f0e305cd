"""The command itself: verbs, exit codes, and no traceback for what a user does."""

import re
import signal
import subprocess
import sys
from types import SimpleNamespace

import pytest

from gateway.cli import main as command
from gateway.cli.main import VERBS, main
from gateway.errors import PortError
from gateway.version import __version__


@pytest.fixture
def verb(monkeypatch):
    """Makes `check` do what the test wants."""

    def replace(run):
        module = SimpleNamespace(add_arguments=lambda parser: None, run=run)
        monkeypatch.setattr(command, "import_module", lambda name: module)

    return replace


def raising(error):
    def run(args):
        raise error

    return run


def test_help_lists_every_verb_and_imports_none(capsys, monkeypatch):
    monkeypatch.setattr(command, "import_module", pytest.fail)
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert all(re.search(f"^    {name}\\b", said, re.MULTILINE) for name in VERBS)


@pytest.mark.parametrize(
    ("words", "wanted"), [(["--help", "ports"], [*VERBS]), (["--nonsense", "ports", "-h"], ["--json"])]
)
def test_help_is_that_of_the_verb_unless_it_stands_before_the_verb(words, wanted, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 0
    said = capsys.readouterr().out
    assert all(each in said for each in wanted)


def test_help_needs_no_heavy_module():
    code = "import sys, gateway.cli.main; sys.exit(bool({'pydantic', 'asyncio', 'structlog'} & set(sys.modules)))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.mark.parametrize("name", VERBS)
def test_every_verb_has_a_module_that_keeps_the_convention(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([name, "--help"])
    assert ended.value.code == 0
    assert f"usage: modbus-gateway {name}" in capsys.readouterr().out


def test_the_version(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["--version"])
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"modbus-gateway {__version__}\n"


@pytest.mark.parametrize("words", [["nonsense"], ["check", "--nonsense"]])
def test_wrong_usage_is_2(words, capsys):
    with pytest.raises(SystemExit) as ended:
        main(words)
    assert ended.value.code == 2
    assert "usage: modbus-gateway" in capsys.readouterr().err


def test_without_a_command_it_says_what_to_do_first(capsys):
    assert main([]) == 2
    assert "modbus-gateway ports\n" in capsys.readouterr().out


@pytest.mark.parametrize("code", [0, 1])
def test_the_verb_says_how_it_ends(code, verb):
    verb(lambda args: code)
    assert main(["check"]) == code


def test_the_words_of_the_command_line_are_the_default(verb, monkeypatch):
    verb(lambda args: 0 if args.verb == "ports" else 1)
    monkeypatch.setattr(sys, "argv", ["modbus-gateway", "ports"])
    assert main() == 0


def test_what_stops_a_verb_is_one_line(verb, capsys):
    verb(raising(PortError("/dev/ttyUSB0: no such port")))
    assert main(["check"]) == 1
    assert capsys.readouterr().err == "modbus-gateway: error: /dev/ttyUSB0: no such port\n"


def test_an_interrupt_is_no_traceback(verb, capsys):
    verb(raising(KeyboardInterrupt()))
    assert main(["check"]) == 128 + signal.SIGINT
    assert capsys.readouterr().err == ""


def test_a_reader_that_has_gone_is_no_traceback():
    """The reading end is closed before anything is written to it."""
    words = [sys.executable, "-m", "gateway.cli.main", "profile", "mint"]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stderr is not None
        process.stdout.close()
        assert process.stderr.read() == b""
    assert process.returncode == 1


def test_a_command_that_is_mistyped_gets_the_nearest_one(capsys):
    with pytest.raises(SystemExit) as ended:
        main(["stauts"])
    assert ended.value.code == 2
    assert 'there is no command stauts; did you mean "status"?' in capsys.readouterr().err
