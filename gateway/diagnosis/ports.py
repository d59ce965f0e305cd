"""Rules about serial ports."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Final

from gateway.diagnosis.evidence import Holder, PortEvidence
from gateway.diagnosis.finding import IS_DOWN, Finding
from gateway.hardware.device_files import make_udev_rule

#: The longest acceptable latency timer of an FTDI adapter, in seconds.
LATENCY: Final = 0.002

#: The name of the gateway's program.
GATEWAY: Final = "modbus-gateway"

#: The commands that keep these programs away from serial ports.
_KEEPING_AWAY: Final = {
    GATEWAY: "give one of the two another port, or stop the other: systemctl stop modbus-gateway, or Ctrl-C",
    "ModemManager": "systemctl disable --now ModemManager",
    "brltty": "systemctl disable --now brltty-udev.service brltty.service",
    "gpsd": "systemctl disable --now gpsd.socket gpsd.service",
}


def about_ports(port: PortEvidence) -> Iterator[Finding]:
    """Find the faults of a port; yield one `ok` if nothing has to be fixed."""
    if not port.exists:
        yield _fix(port, f"{port.port} does not exist", "plug the adapter in; modbus-gateway ports lists what is there")
        return
    troubles = [finding for rule in _RULES for finding in rule(port)]
    yield from troubles
    if not port.is_standby and not any(finding.level == "fix" for finding in troubles):
        yield Finding("ok", _name(port), f"{port.port}: no other program has it open, and {port.user} may open it")


def with_ports(of_ports: Sequence[Finding], others: Iterable[Finding]) -> list[Finding]:
    """Join both, without the rows of lines that are down because of a fault of their port."""
    faulty = {each.about for each in of_ports if each.level == "fix"}
    told = (each for each in others if f"port of {each.about}" not in faulty or not each.what.startswith(IS_DOWN))
    return [*of_ports, *told]


def _permission(port: PortEvidence) -> Iterator[Finding]:
    if port.may_open or port.is_ours:
        return
    what = f"{port.user} may not open {port.port}; the group {port.group} may"
    if port.group == "root":
        yield _fix(port, what, make_udev_rule(port.device))
    elif port.is_virtual:
        yield _fix(port, what, f"chmod 666 {port.port}")
    else:
        yield _fix(port, what, f"usermod -a -G {port.group} {port.user}, then restart the gateway or log in again")


def _other_programs(port: PortEvidence) -> Iterator[Finding]:
    for holder in port.holders:
        if holder.name == GATEWAY and port.is_standby:
            continue  # it has the lease
        yield _fix(port, f"{holder.name} (pid {holder.pid}) has {port.port} open, too", _ending(holder))
    for name in port.probers:
        if port.is_usb and name not in {holder.name for holder in port.holders}:
            what = f"{name} is running; it may open USB adapters when they are plugged in"
            yield Finding("note", _name(port), what, _KEEPING_AWAY.get(name, ""))


def _ending(holder: Holder) -> str:
    """Return the way to end a program; for an interpreter, advice to look first."""
    if holder.is_interpreter:
        return f"ps -fp {holder.pid} shows what it is; end it if nothing needs it"
    return _KEEPING_AWAY.get(holder.name, f"end it: kill {holder.pid}")


def _latency_timer(port: PortEvidence) -> Iterator[Finding]:
    timer = port.latency_timer
    if timer is None or timer <= LATENCY:
        return
    what = f"the adapter holds received bytes back for {timer * 1000:.0f} ms (latency timer)"
    remedy = f"echo 1 > /sys/class/tty/{port.device}/device/latency_timer, or install the udev rules of this package"
    if port.is_ours:
        yield _fix(port, f"{what}, which is added to each response time", remedy)
    else:
        yield Finding("note", _name(port), f"{what}; the gateway sets 1 ms when it opens the port", remedy)


def _stable_path(port: PortEvidence) -> Iterator[Finding]:
    if port.stable_path and port.port != port.stable_path and _has_number(port.port):
        what = f"{port.port} may be another adapter after a restart or a replug"
        yield Finding("note", _name(port), what, f'{port.source}: port = "{port.stable_path}"')


def _has_number(path: str) -> bool:
    return path.startswith(("/dev/ttyUSB", "/dev/ttyACM"))


def _name(port: PortEvidence) -> str:
    return f"port of {port.line}"


def _fix(port: PortEvidence, what: str, remedy: str) -> Finding:
    return Finding("fix", _name(port), what, remedy)


_RULES: Final = (_permission, _other_programs, _latency_timer, _stable_path)
