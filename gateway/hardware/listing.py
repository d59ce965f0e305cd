"""The serial ports of this machine, as the system describes them under /sys and /dev. Nothing is opened."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from serial.tools.list_ports_common import numsplit
from serial.tools.list_ports_linux import SysFS

from gateway.hardware.device_files import advise_on_permission
from gateway.hardware.holders import find_holder

TERMINALS: Final = Path("/sys/class/tty")
DEVICES: Final = Path("/dev")
#: Folders of stable links, the best first: by the adapter's serial number, by its USB socket.
STABLE_LINKS: Final = ("serial/by-id", "serial/by-path")

#: What of a USB device is shown, by its name under /sys.
_OF_USB: Final = {
    "manufacturer": "manufacturer",
    "product": "product",
    "release of the device": "bcdDevice",
    "USB speed, Mbit/s": "speed",
}

State = Literal["free", "in use", "no permission"]


@dataclass(frozen=True, slots=True)
class ListedPort:
    """A serial port with hardware. `path` stays the same when the adapter is plugged in again."""

    path: str
    device: str
    description: str
    driver: str
    state: State
    #: Why it cannot be used, and what to do; empty for a free port.
    remark: str


@dataclass(frozen=True, slots=True)
class Adapter:
    """`ids` are vendor and product, such as `0403:6001`; empty if it is not on USB.

    `links` are the kinds of stable link that lead to it, `latency_timer` is that of an FTDI chip in milliseconds, and
    `usb` is more that the device says of itself.
    """

    device: str
    driver: str
    ids: str
    usb: dict[str, str]
    has_serial_number: bool
    links: tuple[str, ...]
    latency_timer: str


def list_serial_ports() -> list[ListedPort]:
    """List all serial ports with hardware, not virtual ones. Opens none of them."""
    names = sorted((entry.name for entry in TERMINALS.glob("*") if _has_hardware(entry)), key=numsplit)
    devices = [DEVICES / name.replace("!", "/") for name in names]
    links = find_stable_links()
    return [_list(device, links.get(device, device)) for device in devices if device.exists()]


def describe_adapter(port: str, devices: Path = DEVICES, terminals: Path = TERMINALS) -> Adapter:
    """Describe the hardware behind the path of a port; with little in it for a path that leads to none."""
    device = Path(port).resolve()
    hardware = terminals / device.name / "device"
    usb = next(_usb_devices(hardware.resolve()), None)
    told = {name: read_line(usb / file) or "" for name, file in _OF_USB.items()} if usb else {}
    return Adapter(
        device.name,
        find_driver(hardware),
        f"{read_line(usb / 'idVendor')}:{read_line(usb / 'idProduct')}" if usb else "",
        {name: text for name, text in told.items() if text},
        usb is not None and bool(read_line(usb / "serial")),
        tuple(
            folder for folder in STABLE_LINKS if any(link.resolve() == device for link in (devices / folder).glob("*"))
        ),
        read_line(hardware / "latency_timer") or "",
    )


def _has_hardware(terminal: Path) -> bool:
    """Tell a serial port from a virtual terminal, which has no device, and an absent UART, which has one of type 0."""
    if not (terminal / "device").exists():
        return False
    return read_line(terminal / "type") != "0"


def find_stable_links(within: Path | None = None) -> dict[Path, Path]:
    """Find the best stable link to each device, `within` the folder of devices."""
    links: dict[Path, Path] = {}
    for folder in STABLE_LINKS:
        for link in sorted(((within or DEVICES) / folder).glob("*")):
            links.setdefault(link.resolve(), link)
    return links


def _list(device: Path, path: Path) -> ListedPort:
    state, remark = _find_state(device)
    return ListedPort(
        str(path), str(device), _describe(device), find_driver(TERMINALS / device.name / "device"), state, remark
    )


def _find_state(device: Path) -> tuple[State, str]:
    held_by = find_holder(str(device))
    if held_by is not None:
        return "in use", f"by {held_by}"
    if not os.access(device, os.R_OK | os.W_OK):
        return "no permission", advise_on_permission(str(device))
    return "free", ""


def _describe(device: Path) -> str:
    found = SysFS(str(device))
    if found.product is None:
        return "built in"
    return " ".join(part for part in (found.manufacturer, found.product) if part)


def find_driver(hardware: Path) -> str:
    """Name the driver of a terminal's `device`; empty if it has none."""
    place = hardware.resolve()
    while (place / "subsystem").resolve().name == "serial-base":  # the kernel's own layer above a UART's driver
        place = place.parent
    driver = place / "driver"
    return driver.resolve().name if driver.exists() else ""


def read_line(file: Path) -> str | None:
    """Read a file of one line; None if it cannot be read."""
    try:
        return file.read_text().strip()
    except OSError:
        return None


def _usb_devices(hardware: Path) -> Iterator[Path]:
    """Find the USB device that a port is part of, if it is."""
    return (place for place in (hardware, *hardware.parents) if (place / "idVendor").exists())
