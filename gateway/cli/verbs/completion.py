"""`completion`: lets a shell complete commands, options and their values."""

import argparse
from collections.abc import Iterator

from gateway.cli.kit.grammar import Argument, Verb, grammar
from gateway.cli.main import FINE

_PROGRAM, _SHORT = "modbus-gateway", "mbgw"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The arguments of `completion`."""
    parser.add_argument("shell", choices=tuple(_SCRIPTS), help="the shell that reads it")


def run(args: argparse.Namespace) -> int:
    """Print the script."""
    print(completion(args.shell), end="")
    return FINE


def completion(shell: str) -> str:
    """The script that completes our commands in `shell`: bash, zsh or fish."""
    return _SCRIPTS[shell](grammar())


def _bash(verbs: tuple[Verb, ...]) -> str:
    cases = "\n".join(f"        {verb.name}) words={_quoted(_flags(verb))} ;;" for verb in verbs)
    values = "\n".join(f"        {case}) words={_quoted(choices)} ;;" for case, choices in _bash_values(verbs))
    return f"""\
# Bash completion for modbus-gateway: the output of `modbus-gateway completion bash`.

_modbus_gateway() {{
    local word=${{COMP_WORDS[COMP_CWORD]}} before=${{COMP_WORDS[COMP_CWORD - 1]}} verb=${{COMP_WORDS[1]}} words=
    COMPREPLY=()
    if ((COMP_CWORD == 1)); then
        words={_quoted([*(verb.name for verb in verbs), "--help", "--version"])}
    elif [[ $word == -* ]]; then
        case $verb in
{cases}
        esac
    else
        case "$verb $before" in
{values}
        esac
    fi
    if [[ $words ]]; then
        mapfile -t COMPREPLY < <(compgen -W "$words" -- "$word")
    fi
}}

complete -o default -F _modbus_gateway {_PROGRAM} {_SHORT}
"""


def _bash_values(verbs: tuple[Verb, ...]) -> Iterator[tuple[str, tuple[str, ...]]]:
    """Values that are known, by the command and the word before them."""
    for verb in verbs:
        first = next(iter(verb.words), None)
        if first is not None and first.choices:
            yield f'"{verb.name} {verb.name}"', first.choices
        for option in verb.options:
            if option.choices:
                yield "|".join(f'"{verb.name} {flag}"' for flag in option.flags), option.choices


def _zsh(verbs: tuple[Verb, ...]) -> str:
    names = "\n".join(f"        {_zsh_quoted(f'{verb.name}:{verb.summary}')}" for verb in verbs)
    cases = "\n".join(_zsh_case(verb) for verb in verbs)
    return f"""\
#compdef {_PROGRAM} {_SHORT}
# Zsh completion for modbus-gateway: the output of `modbus-gateway completion zsh`.

local -a verbs
if ((CURRENT == 2)); then
    verbs=(
{names}
    )
    _describe command verbs
    return
fi
local verb=$words[2]
shift words
((CURRENT--))
case $verb in
{cases}
    *) _files ;;
esac
"""


def _zsh_case(verb: Verb) -> str:
    specs = [spec for option in verb.options for spec in _zsh_option(option)]
    first = next(iter(verb.words), None)
    if first is not None and first.choices:
        specs.append(_zsh_quoted(f"1:{first.value}:({' '.join(first.choices)})"))
    lines = " \\\n            ".join([*specs, _zsh_quoted("*:file:_files")])
    return f"    {verb.name})\n        _arguments \\\n            {lines}\n        ;;"


def _zsh_option(option: Argument) -> Iterator[str]:
    text = "".join(f"\\{letter}" if letter in "[]:\\" else letter for letter in option.help)
    value = ""
    if option.value:
        name = option.value.replace(":", " ")
        value = f":{name}:({' '.join(option.choices)})" if option.choices else f":{name}:_files"
    return (_zsh_quoted(f"{flag}[{text}]{value}") for flag in option.flags)


def _fish(verbs: tuple[Verb, ...]) -> str:
    lines = [
        "# Fish completion for modbus-gateway: the output of `modbus-gateway completion fish`.",
        "",
        f"complete -c {_SHORT} -w {_PROGRAM}",
    ]
    first_word = f"complete -c {_PROGRAM} -f -n __fish_use_subcommand"
    lines += (f"{first_word} -a {verb.name} -d {_quoted([verb.summary])}" for verb in verbs)
    for verb in verbs:
        seen = f"complete -c {_PROGRAM} -n '__fish_seen_subcommand_from {verb.name}'"
        first = next(iter(verb.words), None)
        if first is not None and first.choices:
            lines.append(f"{seen} -a {_quoted(first.choices)}")
        lines += (f"{seen} {_fish_option(option)}" for option in verb.options)
    return "\n".join(lines) + "\n"


def _fish_option(option: Argument) -> str:
    flags = [f"-l {flag[2:]}" if flag.startswith("--") else f"-s {flag[1:]}" for flag in option.flags]
    value = [] if not option.value else ["-x -a", _quoted(option.choices)] if option.choices else ["-r"]
    return " ".join([*flags, *value, "-d", _quoted([option.help])])


def _flags(verb: Verb) -> list[str]:
    return [flag for option in verb.options for flag in option.flags]


def _quoted(words: list[str] | tuple[str, ...]) -> str:
    """Words as one string; bash and fish read a quote and a backslash alike between double quotes."""
    text = " ".join(words)
    return '"' + "".join(f"\\{letter}" if letter in '\\"$' else letter for letter in text) + '"'


def _zsh_quoted(text: str) -> str:
    return "'" + text.replace("'", "'\\''") + "'"


_SCRIPTS = {"bash": _bash, "zsh": _zsh, "fish": _fish}
