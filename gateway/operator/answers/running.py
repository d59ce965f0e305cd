"""Which gateway answers, and what its reload has changed."""

from dataclasses import dataclass

from gateway.runtime.outcome import Outcome


@dataclass(frozen=True, slots=True)
class Which:
    """The gateway that runs with the file `config`."""

    config: str


@dataclass(frozen=True, slots=True)
class Reloaded(Outcome):
    """The outcome of a reload of `file`; it is not `ok` if the file was rejected, or a defect was found."""

    ok: bool = True
    file: str = ""
