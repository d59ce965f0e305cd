"""What the rest of the gateway sees of a port, whatever stands behind it."""

from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from typing import Literal, Protocol

from gateway.errors import PortError
from gateway.timing.characters import CharacterFormat


class Port(Protocol):
    """An open port. All of it is called in the event loop and nothing blocks."""

    #: What adapter and driver may add to an answer, in seconds: part of every time limit on this port.
    latency: float
    #: It carries bytes at once instead of at the line's rate: a pseudo-terminal, a TCP connection.
    virtual: bool
    #: The rate at which it was opened and runs, as far as its driver tells; None where the rate is set elsewhere.
    baud: int | None

    @property
    def has_arrived(self) -> Callable[[], bool] | None:
        """Tells whether all that was written has arrived at the other end. None: this port is no connection."""

    def write(self, data: bytes) -> None:
        """Send `data` now. When the port fails, `PortUser.lost` follows; this never raises."""

    def pause(self) -> bool:
        """Hand over nothing until `read_now`: what comes waits. False if this port hands it over all the same."""

    def read_now(self) -> None:
        """Hand over what has come up to now, at once, and from now on as it comes."""

    def change_baud(self, baud: int) -> None:
        """Go on at another rate, within a few milliseconds. When the port cannot, `PortUser.lost` follows."""

    def close(self) -> None:
        """Let go of the port; `PortUser.lost` follows if it has not been called yet."""

    async def wait_closed(self) -> None:
        """Wait until a port that was closed or lost is free again. The caller sets the deadline: a driver may hang."""


class Received(Protocol):
    """Who takes bytes."""

    def __call__(self, data: bytes, *, damaged: bool = False) -> None:
        """These bytes became readable; `damaged`: at least one of them is not what was sent."""


class PortUser(Protocol):
    """Who is told what a port does."""

    @property
    def received(self) -> Received:
        """Takes what became readable."""

    def lost(self, error: PortError) -> None:
        """The port is gone; nothing more comes from it. Called once for every port that was opened."""


#: Opens a port for a user. Raises PortError with the reason, in words an operator can act on.
#: The user hears nothing before its opener has the port. Cancelled, it leaves nothing open.
OpenPort = Callable[[PortUser], Awaitable[Port]]


@dataclass(frozen=True, slots=True)
class SerialSettings:
    """How a serial port is opened. `latency` None finds out what the driver can do."""

    port: str
    baud: int
    format: CharacterFormat
    rs485: Literal["adapter", "kernel"] = "adapter"
    latency: float | None = None


@dataclass(frozen=True, slots=True)
class TcpSettings:
    """A server to connect to: a device server, or another Modbus TCP server. `port` is what messages call it.

    `latency` is what network and server may add to an answer, in seconds.
    """

    port: str
    host: str
    number: int
    latency: float = 0.0


#: How any port is opened.
PortSettings = SerialSettings | TcpSettings


#: How a port with these settings is opened: real ones in the service, memory ports in tests.
Opener = Callable[[PortSettings], OpenPort]
