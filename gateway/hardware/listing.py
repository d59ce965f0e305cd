"""The serial ports of this machine, and the path of each for a config."""

import os
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from serial.tools.list_ports_common import numsplit
from serial.tools.list_ports_linux import SysFS

from gateway.hardware.holders import holder
from gateway.ports.reasons import permission_remedy

TERMINALS: Final = Path("/sys/class/tty")
DEVICES: Final = Path("/dev")
#: Folders of stable links, the best first: by the adapter's serial number, by its USB socket.
STABLE_LINKS: Final = ("serial/by-id", "serial/by-path")

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


def serial_ports() -> list[ListedPort]:
    """All serial ports with hardware, not virtual ones. Opens none of them."""
    names = sorted((entry.name for entry in TERMINALS.glob("*") if _has_hardware(entry)), key=numsplit)
    devices = [DEVICES / name.replace("!", "/") for name in names]
    links = stable_links()
    return [_listed(device, links.get(device, device)) for device in devices if device.exists()]


def _has_hardware(terminal: Path) -> bool:
    """Virtual terminals have no device; an absent UART has one of type 0."""
    if not (terminal / "device").exists():
        return False
    return line_of(terminal / "type") != "0"


def stable_links(within: Path | None = None) -> dict[Path, Path]:
    """The best stable link to each device, `within` the folder of devices."""
    links: dict[Path, Path] = {}
    for folder in STABLE_LINKS:
        for link in sorted(((within or DEVICES) / folder).glob("*")):
            links.setdefault(link.resolve(), link)
    return links


def _listed(device: Path, path: Path) -> ListedPort:
    state, remark = _state(device)
    return ListedPort(
        str(path), str(device), _description(device), driver_of(TERMINALS / device.name / "device"), state, remark
    )


def _state(device: Path) -> tuple[State, str]:
    held_by = holder(str(device))
    if held_by is not None:
        return "in use", f"by {held_by}"
    if not os.access(device, os.R_OK | os.W_OK):
        return "no permission", permission_remedy(str(device))
    return "free", ""


def _description(device: Path) -> str:
    found = SysFS(str(device))
    if found.product is None:
        return "built in"
    return " ".join(part for part in (found.manufacturer, found.product) if part)


def driver_of(hardware: Path) -> str:
    """The name of the driver of a terminal's `device`; empty if it has none."""
    place = hardware.resolve()
    while (place / "subsystem").resolve().name == "serial-base":  # the kernel's own layer above a UART's driver
        place = place.parent
    driver = place / "driver"
    return driver.resolve().name if driver.exists() else ""


def line_of(file: Path) -> str | None:
    """What stands in a file of one line; None if it cannot be read."""
    try:
        return file.read_text().strip()
    except OSError:
        return None
