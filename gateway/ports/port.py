"""The interface of ports to the rest of the gateway."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from gateway.errors import PortError
from gateway.timing.characters import CharacterFormat
from gateway.tls.settings import ClientTls

#: `serial`: at the line's rate, `direct`: at once, `auto`: depending on the port.
Wire = Literal["auto", "serial", "direct"]


@dataclass(frozen=True, slots=True)
class CharacterErrors:
    """Characters that a driver has received, and those among them that it found wrong, since the port was opened.

    `overrun` are characters that were lost because nobody took those before them in time.
    """

    received: int
    framing: int
    parity: int
    overrun: int


class Port(Protocol):
    """An open port. All of it is called in the event loop and nothing blocks."""

    #: What adapter and driver may add to a response, in seconds: part of every time limit.
    latency: float
    #: It carries bytes at once instead of at the line's rate: a pseudo-terminal, a TCP connection.
    is_virtual: bool
    #: Its actual rate, if its driver reports it; None if the rate is set elsewhere.
    baud: int | None

    @property
    def has_arrived(self) -> Callable[[], bool] | None:
        """Tell whether the other end has received all that was written. None: this port is no connection."""

    @property
    def errors(self) -> CharacterErrors | None:
        """Count wrong characters; None if the driver does not."""

    def write(self, data: bytes) -> None:
        """Send `data` now. When the port fails, `PortUser.lost` follows; this never raises."""

    def pause(self) -> bool:
        """Deliver nothing until `read_now`: received bytes wait. False if this port cannot do that."""

    def read_now(self) -> None:
        """Deliver all bytes received up to now, and from now on deliver bytes as they come."""

    def change_baud(self, baud: int) -> None:
        """Change the rate, within a few milliseconds. If that fails, `PortUser.lost` follows."""

    def close(self) -> None:
        """Close the port; `PortUser.lost` follows if it has not been called yet."""

    async def wait_closed(self) -> None:
        """Wait until a closed or lost port is free again. The caller sets the deadline: a driver may hang."""


class Received(Protocol):
    """A function that takes received bytes."""

    def __call__(self, data: bytes, *, damaged: bool = False) -> None:
        """Take received bytes; `damaged`: at least one of them is not what was sent."""


class PortUser(Protocol):
    """The user of a port, with its callbacks."""

    @property
    def received(self) -> Received:
        """Take received bytes."""

    def lost(self, error: PortError) -> None:
        """Take note that the port was closed or lost. Called once for every port that was opened."""


#: Has a connection opened again that is closed because nobody needed it.
OpenAgain = Callable[[], None]

#: Opens a port for a user. Raises PortError with the reason and what to do. The user gets no callback before the
#: port is returned. If cancelled, nothing stays open.
OpenPort = Callable[[PortUser], Awaitable[Port]]


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """The settings of a serial port. `latency` None: depending on the driver."""

    port: str
    baud: int
    format: CharacterFormat
    rs485: Literal["adapter", "kernel"] = "adapter"
    latency: float | None = None


@dataclass(frozen=True, slots=True)
class TcpSettings:
    """The settings of a connection to a device server, or to another Modbus TCP server. `port` is its name in messages.

    `latency` is what network and server may add to a response, in seconds. `tls` secures the connection.
    What is written arrives within `arrives_within` seconds, or never: then the connection ends. With `drops_early`,
    what is received within the latency after connecting is dropped: nobody knows how old it is.
    """

    port: str
    host: str
    number: int
    latency: float = 0.0
    tls: ClientTls | None = None
    arrives_within: float = 20.0
    drops_early: bool = False


@dataclass(frozen=True, slots=True)
class SiteSettings:
    """The way to the gateway of another `site`. `port` is its name in messages."""

    port: str
    site: str


#: The settings of any port.
PortSettings = SerialSettings | TcpSettings


#: The function that opens ports with these settings: real ones in the service, memory ports in tests.
Opener = Callable[[PortSettings], OpenPort]


def resolve_wire(wire: Wire, *, is_virtual: bool) -> Wire:
    """Say what `wire` means on this port: `serial` or `direct`."""
    if wire != "auto":
        return wire
    return "direct" if is_virtual else "serial"
