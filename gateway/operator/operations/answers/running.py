"""Results of `which` and `reload`."""

from dataclasses import dataclass

from gateway.runtime.outcome import Outcome


@dataclass(frozen=True, slots=True)
class Which:
    """The config file of the running gateway."""

    config: str


@dataclass(frozen=True, slots=True)
class Reloaded(Outcome):
    """The outcome of a reload of `file`; not `ok` if the file was rejected or a defect was found."""

    ok: bool = True
    file: str = ""
