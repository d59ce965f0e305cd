"""Faults of whole set-ups, each with a word for `simulate --fault`. `doctor` finds them."""

from collections.abc import Set as AbstractSet
from copy import deepcopy
from dataclasses import replace
from typing import Final

from gateway.modbus.codes import LAST_UNIT
from gateway.simulator.device import Device
from gateway.simulator.faults import LineFaults

#: The words, and what each means.
FAULTS: Final = {
    "duplicate-address": "a second device has the address of the first",
    "echo": "the adapter returns what is sent",
    "second-client": "another client polls on the line",
    "silent": "no device responds",
    "slow": "the devices take longer than their profile allows",
    "swapped-address": "the first device has an address that the config does not name",
    "wrong-parity": "the devices are set to another parity: they find no valid character",
    "wrong-rate": "the devices are set to another rate",
}

#: Those that a device has without a line.
OF_DEVICES: Final = frozenset({"silent", "slow", "swapped-address"})

#: How much later a second device with the same address answers, in seconds.
_BEHIND: Final = 0.002


def line_faults(words: AbstractSet[str]) -> LineFaults:
    """Return the faults of the line itself among `words`."""
    return LineFaults(echo="echo" in words, second_client="second-client" in words)


def with_faults(devices: list[Device], words: AbstractSet[str], baud: int) -> list[Device]:
    """Apply the faults in `words` to `devices`, and return them, with a second one for `duplicate-address`.

    `baud` is the rate in the config.
    """
    for device in devices:
        silent = device.faults.silent or not words.isdisjoint(("silent", "wrong-parity"))
        device.faults = replace(device.faults, silent=silent, late="slow" in words)
        if "wrong-rate" in words:
            device.baud = 19200 if baud == 9600 else 9600
    if "swapped-address" in words:
        devices[0].unit = _free_address(devices)
    if "duplicate-address" in words:
        devices = [*devices, _twin(devices[0])]
    return devices


def _free_address(devices: list[Device]) -> int:
    """Return the next free address after the one of the first device."""
    taken = {device.unit for device in devices}
    behind = [*range(devices[0].unit + 1, LAST_UNIT + 1), *range(1, devices[0].unit)]
    free: list[int] = [unit for unit in behind if unit not in taken]
    return free[0]


def _twin(device: Device) -> Device:
    twin = deepcopy(device)
    twin.faults = replace(device.faults, slow=device.faults.slow + _BEHIND)
    return twin
