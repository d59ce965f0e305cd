"""The completions and the examples: made of what the command line understands."""

import re
import subprocess
from argparse import SUPPRESS
from pathlib import Path

import pytest

from deploy.completions import COMPLETIONS, completions
from gateway.cli.kit.examples import EXAMPLES
from gateway.cli.main import VERBS, main, parser_of_all
from gateway.cli.verbs.completion import SCRIPTS

FILES = completions()


def options(parser, *words):
    """The options of a parser and of those in it, each with the words before them."""
    for action in (each for each in parser._actions if each.help != SUPPRESS):
        yield from ((words, flag) for flag in action.option_strings)
        if isinstance(action.choices, dict):
            for word, each in action.choices.items():
                yield from options(each, *words, word)


OPTIONS = list(options(parser_of_all()[0]))


def completed(shell: str, typed: str, folder: Path) -> set[str]:
    """What a shell offers for the last of the words."""
    script = COMPLETIONS / SCRIPTS[shell]
    if shell == "fish":
        ask = f'source {script}; complete -C "{typed}"'
        words = ["fish", "--no-config", "-c", ask]
    else:
        ask = f'source {script}; COMP_WORDS=("$@"); COMP_CWORD=$(($# - 1)); _shtab_modbus_gateway "$1"'
        words = [
            "bash",
            "-c",
            f'compopt() {{ :; }}; {ask}; printf "%s\\n" "${{COMPREPLY[@]}}"',
            "bash",
            *typed.split(" "),
        ]
    said = subprocess.run(words, capture_output=True, text=True, check=True, cwd=folder).stdout
    return {line.partition("\t")[0] for line in said.splitlines()}


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.name)
def test_the_files_are_current(file):
    assert file.read_text(encoding="utf-8") == FILES[file], "not current: uvx nox -s gen"


@pytest.mark.parametrize("shell", SCRIPTS)
def test_the_command_prints_the_script(shell, capsys):
    assert main(["completion", shell]) == 0
    assert capsys.readouterr().out == FILES[COMPLETIONS / SCRIPTS[shell]]


@pytest.mark.parametrize("verb", VERBS)
def test_every_command_has_an_example_in_its_help(verb, capsys):
    with pytest.raises(SystemExit):
        main([verb, "--help"])
    said = capsys.readouterr().out
    assert "example" in said
    assert f"  modbus-gateway {verb}" in said


@pytest.mark.parametrize(("verb", "typed"), [(verb, typed) for verb in VERBS for typed, _ in EXAMPLES[verb]])
def test_the_examples_can_be_understood(verb, typed):
    words = re.split(r" [>|<] ", typed)[0].split()
    assert words[0] == verb
    parser_of_all()[1][verb].parse_args(words[1:])


@pytest.mark.parametrize("shell", SCRIPTS)
def test_every_command_and_option_is_completed(shell):
    script = FILES[COMPLETIONS / SCRIPTS[shell]]
    assert all(verb in script for verb in VERBS)
    for _, flag in OPTIONS:
        assert (f"-l {flag[2:]}" if shell == "fish" and flag.startswith("--") else flag.lstrip("-")) in script


@pytest.mark.parametrize("shell", [pytest.param(shell, marks=pytest.mark.needs(shell)) for shell in SCRIPTS])
def test_a_shell_can_read_its_script(shell):
    subprocess.run([shell, "-n", COMPLETIONS / SCRIPTS[shell]], check=True)


@pytest.mark.parametrize("shell", [pytest.param(shell, marks=pytest.mark.needs(shell)) for shell in ("bash", "fish")])
@pytest.mark.parametrize(
    ("typed", "offered"),
    [
        ("modbus-gateway ", set(VERBS)),
        ("modbus-gateway --", {"--help", "--version"}),
        ("modbus-gateway check --j", {"--json"}),
        ("modbus-gateway profile --mode a", {"ascii"}),
        ("modbus-gateway import ", {"mbusd", "modbus-proxy", "csv", "home-assistant"}),
        ("modbus-gateway ask tr", {"trace"}),
        ("modbus-gateway certificates rev", {"revoke"}),
        ("modbus-gateway user add --role ", {"viewer", "operator"}),
        ("modbus-gateway check my", {"my.toml"}),
        ("modbus-gateway status --config my", {"my.toml"}),
        ("modbus-gateway import mbusd my", {"my.toml"}),
        ("modbus-gateway simulate mint:1 --port my", {"my.toml"}),
    ],
)
def test_a_shell_offers(shell, typed, offered, tmp_path):
    (tmp_path / "my.toml").touch()
    (tmp_path / "other.toml").touch()
    assert completed(shell, typed, tmp_path) == offered


@pytest.mark.needs("fish")
def test_the_short_name_is_completed_too(tmp_path):
    assert completed("fish", "mbgw che", tmp_path) == {"check"}
    assert "-F _shtab_modbus_gateway modbus-gateway mbgw\n" in FILES[COMPLETIONS / SCRIPTS["bash"]]
    assert FILES[COMPLETIONS / SCRIPTS["zsh"]].startswith("#compdef modbus-gateway mbgw\n")
