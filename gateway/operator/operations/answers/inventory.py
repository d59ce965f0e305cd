"""The result of `inventory`. Times are text (RFC 3339, UTC)."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

from gateway.tls.status import CertificateStatus


@dataclass(frozen=True, slots=True)
class AppliedConfig:
    """The config in use: its `file`, the SHA-256 of the text that was applied, in hexadecimal, and when that was.

    Sites have the same `fingerprint` if only their names, secrets and comments differ.
    """

    file: str
    sha256: str
    fingerprint: str
    applied: str


@dataclass(frozen=True, slots=True)
class InventoryAdapter:
    """The hardware behind the serial port of a `line`, as the system knows it; little is known of one that is away.

    `ids` are vendor and product on USB, such as `0403:6001`, and `usb` is what else the device says of itself.
    """

    line: str
    port: str
    device: str
    driver: str
    ids: str
    usb: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class InventoryLine:
    """A line, or a connection to another server; that has no `baud` and no `format`."""

    name: str
    role: Literal["client", "server", "upstream", "monitor"]
    port: str
    mode: str
    baud: int | None
    format: str | None


@dataclass(frozen=True, slots=True)
class InventoryDevice:
    """A device: `unit` to clients, None if it has no number there, `on_the_wire` on the `line` or behind the server."""

    name: str
    unit: int | None
    on_the_wire: int
    line: str
    profile: str


@dataclass(frozen=True, slots=True)
class Inventory:
    """What this gateway is and has. `started` is when the process began to serve.

    Units of a line that are passed through are not listed as devices.
    """

    version: str
    host: str
    site: str
    started: str
    config: AppliedConfig
    adapters: tuple[InventoryAdapter, ...]
    lines: tuple[InventoryLine, ...]
    devices: tuple[InventoryDevice, ...]
    certificates: tuple[CertificateStatus, ...]
