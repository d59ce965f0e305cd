"""Remembered values of earlier runs: devices that moved, and lines that changed their rate."""

from collections import Counter
from collections.abc import Iterator, Mapping

from gateway.config.plan import LinePlan, Plan
from gateway.config.source import place_of
from gateway.devices.device import DeviceSettings
from gateway.devices.quirks import BAUD_RATES
from gateway.events import AddressRemembered, BaudRemembered
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT
from gateway.service.state import Memory


def rate_key(line: LinePlan) -> str:
    """The key for a line's rate: its port, so that a line of another config is not meant."""
    return line.port.port


def address_key(line: LinePlan, device: DeviceSettings) -> str:
    """The key for a device's address."""
    return f"{line.port.port} {device.name}"


def rate(line: LinePlan, memory: Memory) -> int:
    """The present rate of the line."""
    configured = line.line.timing.baud
    now = memory.recall(rate_key(line), configured)
    return now if now in BAUD_RATES else configured


def addresses(line: LinePlan, memory: Memory) -> Mapping[str, int]:
    """The address of each device of the line, by name: where it moved to, unless another device is there now."""
    now = {each.name: memory.recall(address_key(line, each), each.unit) for each in line.devices}
    taken = Counter(now.values())
    free = {name for name, unit in now.items() if taken[unit] == 1 and FIRST_UNIT <= unit <= LAST_UNIT}
    return {each.name: now[each.name] if each.name in free else each.unit for each in line.devices}


def in_force(plan: Plan, memory: Memory) -> Iterator[AddressRemembered | BaudRemembered]:
    """All remembered values that the gateway uses instead of the config."""
    to_forget = f"to forget it, stop the gateway and delete its entry in {memory.file}, or the file"
    for line in plan.lines:
        name, configured, now = line.line.name, line.line.timing.baud, rate(line, memory)
        if now != configured:
            place = place_of(line.line.source, "baud")
            advice = f"its device changed the rate in an earlier run; set baud = {now} in {place}; {to_forget}"
            yield BaudRemembered(name, now, configured, advice)
        at = addresses(line, memory)
        for device in line.devices:
            if at[device.name] != device.unit:
                place = place_of(device.source, "unit")
                advice = f"it moved in an earlier run; set unit = {at[device.name]} in {place}; {to_forget}"
                yield AddressRemembered(name, device.name, at[device.name], device.unit, advice)
