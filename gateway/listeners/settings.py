"""The settings of a listener, and the failures that it does not report to clients."""

from dataclasses import dataclass, field
from typing import Final, Literal

from gateway.errors import ExceptionCode
from gateway.request import Request
from gateway.tls.settings import ServerTls

#: The reaction when there is no response: an exception with the reason, or nothing, like a device that is switched off.
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
    """One address where clients connect. Times in seconds; `idle` 0 keeps connections forever.

    `reserve` of the `clients` are only for addresses that rows of the rights name. `scheme` is the protocol: `tcp`,
    `tls`, `rtu+tcp`, `ascii+tcp` or `udp`; `tls` names the files for `tls`. `ipv6_only`, for the host `::`, leaves IPv4
    clients to another listener on the same port. `on_failure` is the reaction when a unit does not respond. `line` or
    `upstream` is set on a listener for a single one. `shares_port`: another listener uses this port at another address.
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
        """The name of the only line or upstream that it leads to; empty for all units."""
        return self.line or self.upstream


def is_kept_back(request: Request, on_failure: OnFailure) -> bool:
    """Tell whether the failure of a request is not reported to the client.

    An exception of the unit itself is a response, whatever its code.
    """
    return request.error is not None and on_failure == "silent" and request.error.code in _WITHOUT_ANSWER
