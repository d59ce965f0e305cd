"""Evidence about a serial port without opening it: permissions, programs that have it open, the latency timer."""

import os
import pwd
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from gateway.diagnosis.evidence import Holder, PortEvidence, PortInUse
from gateway.diagnosis.finding import Finding
from gateway.diagnosis.ports import about_ports
from gateway.hardware.device_files import VIRTUAL_MAJORS, find_group
from gateway.hardware.holders import PROC, find_holders, is_interpreter, list_programs, name_program
from gateway.hardware.listing import DEVICES, TERMINALS, find_stable_links

#: Programs that probe serial ports when they appear.
PROBERS: Final = frozenset({"ModemManager", "brltty", "gpsd"})


@dataclass(frozen=True, slots=True)
class Places:
    """Folders of the system; tests use others."""

    devices: Path = DEVICES
    terminals: Path = TERMINALS
    programs: Path = PROC


def findings_about(ports: Iterable[PortInUse], gateway_pid: int | None) -> list[Finding]:
    """Examine ports from outside. `gateway_pid` is the process of the gateway, None if it does not run."""
    return [finding for port in ports for finding in about_ports(look_at(port, gateway_pid))]


def look_at(port: PortInUse, gateway_pid: int | None, places: Places = Places()) -> PortEvidence:
    """Gather the evidence about `port`. `gateway_pid` is the process of the gateway, None if it does not run."""
    path = Path(port.port)
    try:
        device, status = path.resolve(strict=True), path.stat()
    except OSError:
        return PortEvidence(port.line, port.source, port.port, exists=False)
    user, may_open = _user(gateway_pid, status, places)
    pids = find_holders(device, places.programs) - {gateway_pid, os.getpid()}
    terminal = places.terminals / device.name
    return PortEvidence(
        line=port.line,
        source=port.source,
        port=port.port,
        device=device.name,
        is_virtual=os.major(status.st_rdev) in VIRTUAL_MAJORS,
        is_usb=(terminal / "device/subsystem").resolve().name in ("usb", "usb-serial"),
        stable_path=str(find_stable_links(places.devices).get(device, "")),
        user=user,
        may_open=may_open,
        group=find_group(str(device)),
        latency_timer=_latency_timer(terminal),
        is_ours=port.is_open,
        is_standby=port.is_standby,
        holders=tuple(_holder(pid, places.programs) for pid in sorted(pids)),
        probers=tuple(sorted(PROBERS & list_programs(places.programs))),
    )


def _holder(pid: int, programs: Path) -> Holder:
    name = name_program(pid, programs)
    return Holder(name, pid, is_interpreter(name))


def _latency_timer(terminal: Path) -> float | None:
    """Read the latency timer of an FTDI adapter, in seconds; None for others."""
    with suppress(OSError, ValueError):
        return int((terminal / "device/latency_timer").read_text()) / 1000
    return None


def _user(pid: int | None, node: os.stat_result, places: Places) -> tuple[str, bool]:
    """Return the user of the gateway, else of this command, and whether that user may read and write the port."""
    ids = None if pid is None else _ids(places.programs / str(pid))
    uid, groups = ids or (os.geteuid(), {os.getegid(), *os.getgroups()})
    mode = node.st_mode
    if uid == 0:
        may_open = True
    elif uid == node.st_uid:
        may_open = mode & 0o600 == 0o600
    elif node.st_gid in groups:
        may_open = mode & 0o060 == 0o060
    else:
        may_open = mode & 0o006 == 0o006
    try:
        name = pwd.getpwuid(uid).pw_name
    except KeyError:
        name = f"user {uid}"
    return name, may_open


def _ids(process: Path) -> tuple[int, set[int]] | None:
    """Read the effective user and the groups of a process; None if they cannot be read."""
    fields = {}
    with suppress(OSError, ValueError, KeyError, IndexError):
        for line in (process / "status").read_text().splitlines():
            key, _, value = line.partition(":")
            fields[key] = value.split()
        return int(fields["Uid"][1]), {int(fields["Gid"][1]), *map(int, fields["Groups"])}
    return None
