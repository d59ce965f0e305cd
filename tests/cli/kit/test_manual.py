"""The manual page, the completions and the examples: made of what the command line understands."""

import re
import subprocess
from pathlib import Path

import pytest

from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.kit.grammar import grammar
from gateway.cli.kit.manual import manual
from gateway.cli.main import VERBS, main, parser_of_all
from gateway.cli.verbs.completion import completion

DEPLOY = Path(__file__).parents[3] / "deploy"
PAGE = DEPLOY / "man" / "modbus-gateway.1"
FILES = {"bash": "modbus-gateway", "zsh": "_modbus-gateway", "fish": "modbus-gateway.fish"}
OPTIONS = [(verb.name, flag) for verb in grammar() for option in verb.options for flag in option.flags]


def test_the_page_is_current():
    command = "run: python -m gateway.cli.kit.manual > deploy/man/modbus-gateway.1"
    assert PAGE.read_text(encoding="utf-8") == manual(), command


@pytest.mark.parametrize(("shell", "file"), FILES.items())
def test_the_completions_are_current(shell, file):
    command = f"run: modbus-gateway completion {shell} > deploy/completions/{file}"
    assert (DEPLOY / "completions" / file).read_text(encoding="utf-8") == completion(shell), command


def test_the_page_has_every_command_with_its_options():
    sections = re.split(r"^\.SS ", manual(), flags=re.MULTILINE)[1:]
    assert [section.split()[0] for section in sections] == list(VERBS)
    for name, flag in OPTIONS:
        section = next(one for one in sections if one.startswith(name))
        assert flag in ("-h", "--help") or flag.replace("-", "\\-") in section


@pytest.mark.needs("groff")
def test_roff_has_no_complaints_about_the_page():
    words = ["groff", "-man", "-Tutf8", "-ww", "-z"]
    done = subprocess.run(words, input=manual(), capture_output=True, text=True, check=True)
    assert done.stderr == ""


@pytest.mark.parametrize("verb", VERBS)
def test_every_command_has_an_example_in_its_help(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    said = capsys.readouterr().out
    assert "example" in said
    assert f"  modbus-gateway {verb}" in said


@pytest.mark.parametrize(("verb", "typed"), [(verb, typed) for verb in VERBS for typed, _ in EXAMPLES[verb]])
def test_the_examples_can_be_understood(verb, typed):
    words = typed.split(" > ")[0].split()
    assert words[0] == verb
    parser_of_all()[verb].parse_args(words[1:])


@pytest.mark.parametrize("shell", FILES)
def test_every_command_and_option_is_completed(shell):
    script = completion(shell)
    assert all(verb in script for verb in VERBS)
    for _, flag in OPTIONS:
        assert (f"-l {flag[2:]}" if shell == "fish" and flag.startswith("--") else flag.lstrip("-")) in script


@pytest.mark.parametrize("shell", [pytest.param(shell, marks=pytest.mark.needs(shell)) for shell in FILES])
def test_a_shell_can_read_its_script(shell):
    subprocess.run([shell, "-n"], input=completion(shell), check=True, text=True)


def test_the_running_program_has_one_name():
    """Pages and messages call it the gateway."""
    assert "daemon" not in manual().casefold()
