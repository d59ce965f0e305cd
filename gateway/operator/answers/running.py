"""Which gateway answers, what its reload has changed, and the other sites of its fleet."""

from dataclasses import dataclass

from gateway.fleet.status import SiteStatus
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


@dataclass(frozen=True, slots=True)
class Sites:
    """The sites of a fleet, by name."""

    sites: tuple[SiteStatus, ...]
