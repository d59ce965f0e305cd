"""The settings of a listener, and what a client gets without a response from a unit."""

from dataclasses import dataclass, field
from typing import Final, Literal

from gateway.errors import ExceptionCode
from gateway.request import Request
from gateway.tls.settings import ServerTls

#: The exception that says why there is no response; or nothing, as from a device that is switched off.
OnFailure = Literal["exception", "silent"]

#: The gateway's own exceptions: busy, no path to the unit, no response from the unit.
_WITHOUT_ANSWER: Final = frozenset(
    {
        ExceptionCode.SERVER_DEVICE_BUSY,
        ExceptionCode.GATEWAY_PATH_UNAVAILABLE,
        ExceptionCode.GATEWAY_TARGET_FAILED_TO_RESPOND,
    }
)


@dataclass(frozen=True, slots=True)
class ListenSettings:
    """One address where clients connect. Times in seconds; `idle` 0 keeps connections for ever.

    `reserve` of the `clients` are only for addresses that rows of the rights name.
    `scheme` is the protocol: `tcp`, `tls`, `rtu+tcp`, `ascii+tcp` or `udp`; `tls` are the files of the second one.
    `ipv6_only` is for the host `::`: it leaves IPv4 clients to another listener on the same port.
    `on_failure` is what a client gets without a response from a unit. `line` or `upstream` is set on a listener for it.
    `shares_port`: another listener uses this port at another address.
    """

    name: str
    host: str
    port: int
    clients: int = 32
    idle: float = 600.0
    in_flight: int = 16
    unit0: Literal["refuse", "broadcast"] | int = "refuse"
    source: str = field(default="", compare=False)
    scheme: str = "tcp"
    ipv6_only: bool = False
    on_failure: OnFailure = "exception"
    line: str = ""
    upstream: str = ""
    shares_port: bool = field(default=False, compare=False)
    reserve: int = 0
    tls: ServerTls | None = None

    @property
    def only(self) -> str:
        """Return the name of the one line or upstream that it leads to; empty for all units."""
        return self.line or self.upstream


def is_kept_back(request: Request, on_failure: OnFailure) -> bool:
    """Tell whether the failure of a request is not reported to the client.

    An exception of the unit itself is a response, whatever its code.
    """
    return request.error is not None and on_failure == "silent" and request.error.code in _WITHOUT_ANSWER
