"""The hardware of a serial port, as the system describes it under /sys. Nothing is opened.

Nothing here tells one machine or one adapter from another of its kind: a serial number is only said to be there.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.hardware.listing import DEVICES, STABLE_LINKS, TERMINALS, driver_of, line_of

#: What of a USB device is shown, by its name under /sys.
_OF_USB: Final = {
    "manufacturer": "manufacturer",
    "product": "product",
    "release of the device": "bcdDevice",
    "USB speed, Mbit/s": "speed",
}


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


def adapter_of(port: str, devices: Path = DEVICES, terminals: Path = TERMINALS) -> Adapter:
    """The hardware behind the path of a port; with little in it for a path that leads to none."""
    device = Path(port).resolve()
    hardware = terminals / device.name / "device"
    usb = next(_usb_devices(hardware.resolve()), None)
    told = {name: line_of(usb / file) or "" for name, file in _OF_USB.items()} if usb else {}
    return Adapter(
        device.name,
        driver_of(hardware),
        f"{line_of(usb / 'idVendor')}:{line_of(usb / 'idProduct')}" if usb else "",
        {name: text for name, text in told.items() if text},
        usb is not None and bool(line_of(usb / "serial")),
        tuple(
            folder for folder in STABLE_LINKS if any(link.resolve() == device for link in (devices / folder).glob("*"))
        ),
        line_of(hardware / "latency_timer") or "",
    )


def _usb_devices(hardware: Path) -> Iterator[Path]:
    """The USB device that a port is part of, if it is."""
    return (place for place in (hardware, *hardware.parents) if (place / "idVendor").exists())
