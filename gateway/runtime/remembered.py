"""Remembered values of earlier runs: devices that moved, and lines that changed their rate."""

from collections import Counter
from collections.abc import Iterator, Mapping

from gateway.config.plan.settings import LinePlan, Plan
from gateway.config.reading.source import place_of
from gateway.devices.device import DeviceSettings
from gateway.devices.moved import forget_command, how_to_forget, show_addresses
from gateway.devices.quirks import BAUD_RATES
from gateway.events import AddressRemembered, BaudRemembered
from gateway.modbus.codes import FIRST_UNIT, LAST_UNIT
from gateway.state.memory import Memory


def rate_key(line: LinePlan) -> str:
    """Make the key for a line's rate: its port, so that another config's line of this name is not meant."""
    return line.port.port


def address_key(line: LinePlan, device: DeviceSettings) -> str:
    """Make the key for a device's address."""
    return f"{line.port.port} {device.name}"


def rate(line: LinePlan, memory: Memory) -> int:
    """Return the remembered rate of the line, or the configured one."""
    configured = line.line.timing.baud
    now = memory.recall(rate_key(line), configured)
    return now if now in BAUD_RATES else configured


def mistakable(line: LinePlan, memory: Memory) -> dict[str, list[str]]:
    """Find devices that may be either of two earlier ones: by name, the names of the devices that each may be.

    At the configured address was a device that has moved away, and there is now another one. The names of both are gone
    from the config: the device may be the first, under a new name, or the second, whose present address was written
    into the config. To ask it could return the values of the other.
    """
    start = f"{line.port.port} "
    names = {each.name for each in line.devices}
    moved = {
        key.removeprefix(start): entry for key, entry in memory.moved(start) if key.removeprefix(start) not in names
    }
    found = {}
    for each in line.devices:
        if each.profile.quirks and recall(line, each, memory) == (each.unit,):
            left = [name for name, (configured, *_) in moved.items() if configured == each.unit]
            came = [name for name, (configured, *units) in moved.items() if each.unit in units and name not in left]
            if left and came:
                found[each.name] = [*left, *came]
    return found


def forget(line: LinePlan, memory: Memory, device: DeviceSettings) -> None:
    """Forget where a device has moved to, and which others it may be."""
    memory.remember(address_key(line, device), device.unit, device.unit)
    for name in mistakable(line, memory).get(device.name, ()):
        memory.remember(f"{line.port.port} {name}", device.unit, device.unit)


def addresses(line: LinePlan, memory: Memory) -> Mapping[str, tuple[int, ...]]:
    """Return the addresses at which each device of the line is asked, by name: where it moved to, or may have moved to.

    An address that two devices may have is left out: whichever responded could be the other one. So none may be left.
    """
    now, unclear = {each.name: recall(line, each, memory) for each in line.devices}, mistakable(line, memory)
    claims = Counter(unit for units in now.values() for unit in units)
    return {
        name: tuple(unit for unit in units if claims[unit] == 1 and name not in unclear) for name, units in now.items()
    }


def rivals(line: LinePlan, device: DeviceSettings, memory: Memory, *units: int) -> list[str]:
    """Return the names of the other devices that may be at one of `units`."""
    others = (each for each in line.devices if each.name != device.name)
    return [each.name for each in others if not set(units).isdisjoint(recall(line, each, memory))]


def in_force(plan: Plan, memory: Memory) -> Iterator[AddressRemembered | BaudRemembered]:
    """Yield all remembered values that the gateway uses instead of the config."""
    for line in plan.lines:
        name, configured, now = line.line.name, line.line.timing.baud, rate(line, memory)
        if now != configured:
            place = place_of(line.line.source, "baud")
            said = f"its device changed the rate in an earlier run; set baud = {now} in {place}"
            advice = f"{said}; to forget it: {forget_command(line.devices[0].name)}"
            yield BaudRemembered(name, now, configured, advice)
        left, unclear = addresses(line, memory), mistakable(line, memory)
        for device in line.devices:
            units = recall(line, device, memory)
            if device.name in unclear:
                advice = (
                    f"it is not asked: {' and '.join(unclear[device.name])} had changed places, and it may be either; "
                    f"if the unit in {place_of(device.source, 'unit')} is right: {forget_command(device.name)}"
                )
                yield AddressRemembered(name, device.name, units[0], device.unit, advice)
            elif units != (device.unit,) or not left[device.name]:
                advice = _advice(device, units, left[device.name], rivals(line, device, memory, *units))
                yield AddressRemembered(name, device.name, units[0], device.unit, advice)


def _advice(device: DeviceSettings, units: tuple[int, ...], left: tuple[int, ...], others: list[str]) -> str:
    """Say what to do about a device that may be at one of `units`, where `others` may be too; `left` are asked."""
    place = place_of(device.source, "unit")
    if units == (device.unit,):
        ways = " or ".join(map(forget_command, others))
        return f"it is not asked: {' and '.join(others)} may be at its address; {ways}, or set its unit in {place}"
    doubt = f"a change of its address was not answered: it is at {show_addresses(units)}"
    if not left:
        said = f"it is not asked: the config has another device there by now; set its unit in {place}"
    elif len(left) < len(units):
        other = "as the config has another device by now"
        said = f"{doubt}, and asked at {show_addresses(left)} only, {other}; set its unit in {place}"
    elif len(units) > 1:
        said = f"{doubt}, and its next answer settles it"
    else:
        said = f"it moved in an earlier run; set unit = {units[0]} in {place}"
    return f"{said}; {how_to_forget(device.name, device.unit)}"


def recall(line: LinePlan, device: DeviceSettings, memory: Memory) -> tuple[int, ...]:
    """Return the addresses that a device may have; impossible ones are ignored."""
    units = memory.recall_all(address_key(line, device), device.unit)
    return tuple(unit for unit in units if is_possible(device, unit)) or (device.unit,)


def is_possible(device: DeviceSettings, unit: int) -> bool:
    """Return whether the device can be at `unit`: where the config says, or at 1 to 247, which a write can set."""
    return unit == device.unit or FIRST_UNIT <= unit <= LAST_UNIT
