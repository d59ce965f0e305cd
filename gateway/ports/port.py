"""The interface of ports to the rest of the gateway."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Final, Literal, Protocol

from gateway.errors import PortError
from gateway.timing.characters import CharacterFormat
from gateway.tls.settings import ClientTls

#: The error for a connection that its server closes at once.
CLOSED_AT_ONCE: Final = "{port} takes the connection and closes it at once: is somebody else connected?"
#: `serial`: at the line's rate, `direct`: at once, `auto`: depending on the port.
Wire = Literal["auto", "serial", "direct"]


@dataclass(frozen=True, slots=True)
class CharacterErrors:
    """Characters received by a driver, and the faulty ones among them, since the port was opened.

    `overrun` characters were lost because earlier ones were not read in time.
    """

    received: int
    framing: int
    parity: int
    overrun: int


class Port(Protocol):
    """An open port. All methods are called in the event loop, and none blocks."""

    #: The latency of adapter and driver, in seconds: part of every time limit.
    latency: float
    #: Whether it carries bytes at once instead of at the line's rate: a pseudo-terminal, a TCP connection.
    is_virtual: bool
    #: Its actual rate; None if the driver does not report it, or it is set elsewhere.
    baud: int | None

    @property
    def has_arrived(self) -> Callable[[], bool] | None:
        """Tells whether the other end has received all written bytes; None if the port is no connection."""

    @property
    def errors(self) -> CharacterErrors | None:
        """Counts of faulty characters; None if the driver has none."""

    def write(self, data: bytes) -> None:
        """Send `data` now. Never raises; if the port fails, `PortUser.lost` follows."""

    def pause(self) -> bool:
        """Hold back received bytes until `read_now`. Return False if this port cannot do that."""

    def read_now(self) -> None:
        """Deliver all bytes received so far, and from now on bytes as they come."""

    def change_baud(self, baud: int) -> None:
        """Change the rate, within a few milliseconds. If that fails, `PortUser.lost` follows."""

    def close(self) -> None:
        """Close the port; `PortUser.lost` follows if it has not been called yet."""

    async def wait_closed(self) -> None:
        """Wait until a closed or lost port is free again. The caller sets the deadline: a driver may hang."""


class Received(Protocol):
    """A function that takes received bytes."""

    def __call__(self, data: bytes, *, damaged: bool = False) -> None:
        """Take received bytes; at least one of `damaged` bytes differs from what was sent."""


class PortUser(Protocol):
    """The user of a port, with its callbacks."""

    @property
    def received(self) -> Received:
        """The function that takes received bytes."""

    def lost(self, error: PortError) -> None:
        """Handle the end of the port: it was closed or lost. Called once for every opened port."""


#: Opens a connection again that was closed because it was not needed.
OpenAgain = Callable[[], None]

#: Opens a port for a user. Raises PortError with the reason and the remedy. The user gets no callback before the port
#: is returned. If cancelled, nothing stays open.
OpenPort = Callable[[PortUser], Awaitable[Port]]


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """The settings of a serial port. If `latency` is None, it depends on the driver.

    `rs485_delay` are the milliseconds from switching the transmitter on to the first bit, and from the last bit to
    switching it off; None leaves those of the driver.
    With `listens`, it is opened so that it cannot send; see `ListeningPort`.
    """

    port: str
    baud: int
    format: CharacterFormat
    rs485: Literal["adapter", "kernel"] = "adapter"
    latency: float | None = None
    listens: bool = False
    rs485_delay: tuple[int, int] | None = None

    @property
    def driver_delay(self) -> float:
        """The seconds that `rs485_delay` adds to the time from a request to its response."""
        return sum(self.rs485_delay or ()) / 1000


@dataclass(frozen=True, slots=True)
class TcpSettings:
    """The settings of a connection to a device server, or to another Modbus TCP server. `port` is its name in messages.

    `latency` is what network and server may add to a response, in seconds. `tls` secures the connection.
    Written bytes arrive within `arrives_within` seconds, or the connection ends. With `drops_early`, bytes received
    within the latency after connecting are dropped, because their age is unknown. Nothing is sent for `after_connect`
    seconds after connecting. With `listens`, nothing is ever sent; see `ListeningPort`.
    """

    port: str
    host: str
    number: int
    latency: float = 0.0
    tls: ClientTls | None = None
    arrives_within: float = 20.0
    drops_early: bool = False
    after_connect: float = 0.0
    listens: bool = False


@dataclass(frozen=True, slots=True)
class SiteSettings:
    """The port to the gateway of another `site`. `port` is its name in messages."""

    port: str
    site: str


@dataclass(frozen=True, slots=True)
class PtySettings:
    """A virtual serial port, for programs of this machine. `port` is its name in messages.

    `name` is that of its link in the folder of the control socket, or an absolute path. Programs of `group` may use it.
    """

    port: str
    name: str
    group: str
    latency: float


#: The settings of any port.
PortSettings = SerialSettings | TcpSettings | PtySettings


#: Makes the function that opens a port with these settings: real ones in the service, memory ports in tests.
Opener = Callable[[PortSettings], OpenPort]


def resolve_wire(wire: Wire, *, is_virtual: bool) -> Wire:
    """Return what `wire` means on this port: `serial` or `direct`."""
    if wire != "auto":
        return wire
    return "direct" if is_virtual else "serial"
