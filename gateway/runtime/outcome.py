"""What a reload has changed: a module of its own, because the command that asks for a reload loads no event loop."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Outcome:
    """The result of a reload: `problems` if the file was rejected, else the changed tables.

    `restart` are changes that apply after a restart; `warnings` are those of `check`. `defect` is an error that
    occurred after the new config was in use.
    """

    problems: tuple[str, ...] = ()
    added: tuple[str, ...] = ()
    removed: tuple[str, ...] = ()
    changed: tuple[str, ...] = ()
    restart: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    defect: str = ""
