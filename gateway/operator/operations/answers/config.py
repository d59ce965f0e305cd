"""Results of `config` and `check-config`."""

from dataclasses import dataclass

from gateway.readconfig.text_check import TextChanges, TextProblem


@dataclass(frozen=True, slots=True)
class ConfigInUse:
    """The config in use: its `text` without comments and secrets, and the `file` that it was read from."""

    file: str
    text: str


@dataclass(frozen=True, slots=True)
class CheckedConfig:
    """What `check` says of a text; it is `ok` without errors.

    `changes` are those to the config in use, unless they are not known. `difference` has the lines that differ, without
    comments and secrets. `notes` say what was not looked at, and `commands` apply the text once it is in a file.
    """

    ok: bool
    problems: tuple[TextProblem, ...]
    changes: TextChanges | None
    difference: tuple[str, ...]
    notes: tuple[str, ...]
    commands: tuple[str, ...]
