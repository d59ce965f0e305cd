"""The settings of a conversation on one line, and the line and devices that they describe.

`line:` has `mode` (`rtu`: 19200 baud, `ascii`: 9600), `baud`, those of the config (`retries`, `echo`, `gap`, ..),
`shared` (other gateways ask here in turn), and `port`: `virtual` (default), `serial`, whose bytes take their time, or
`connection`. `unit 1:` has `timeout` (200 ms by default), `urgent`, `wake`, `answers_03` (what calibration says of
function 03), `moves` and `changes_baud`; a unit 0 with settings, `unit 0: alone = true`, is one device asked at address
0. `scan:` has `awaits_second` and `patience`.
"""

import re
from collections.abc import Iterable
from dataclasses import replace

from gateway.devices.addresses import UnitAddresses
from gateway.devices.device import Device
from gateway.devices.quirks import AddressZeroDevice, MovableDevice
from gateway.profiles.profile import Profile
from gateway.timing.budget import AnswerTime
from gateway.timing.table import Point, TimingTable
from gateway.trace.ring import Ring
from kit.conversation import seconds
from kit.line_bench import ASCII, TIMING, Bench

Setting = str | float | bool


class StageSettings:
    """Settings by what they are for: `line`, `unit 1`, `scan`."""

    def __init__(self, texts: Iterable[str]) -> None:
        self._parts: dict[str, dict[str, Setting]] = {}
        for each in texts:
            part, _, text = each.partition(": ")
            self._parts.setdefault(part, {}).update(_read_settings(text))

    def of(self, part: str) -> dict[str, Setting]:
        return dict(self._parts.get(part, {}))

    def new_bench(self, ring: Ring) -> Bench:
        """Set up a line as they say; its trace goes to `ring`."""
        settings = self.of("line")
        timing = ASCII if settings.pop("mode", "rtu") == "ascii" else TIMING
        timing = replace(timing, baud=int(settings.pop("baud", timing.baud)))
        port, shared = settings.pop("port", "virtual"), settings.pop("shared", False)
        bench = Bench(virtual=port != "serial", connection=port == "connection", ring=ring, timing=timing, **settings)
        if shared:
            bench.share()
        for part in self._parts:
            if part.startswith("unit "):
                _add_device(bench, int(part.removeprefix("unit ")), self.of(part))
        return bench


def _add_device(bench: Bench, unit: int, settings: dict[str, Setting]) -> None:
    settings.pop("alone", None)
    quirks = frozenset(quirk for quirk in ("moves", "changes_baud") if settings.pop(quirk, False))
    profile = Profile("weigher", quirks=quirks) if quirks else None
    points = {int(key[-2:]): [Point(1, value)] for key, value in settings.items() if key.startswith("answers_")}
    timeout, urgent = settings.pop("timeout", 0.2), settings.pop("urgent", False)
    device = bench.device(unit, profile, timeout, urgent=urgent, wake=settings.pop("wake", 0.0))
    assert all(key.startswith("answers_") for key in settings), settings
    if points:
        device.answer_time = AnswerTime(TimingTable.of(points), margin=1.5, timeout=timeout)
    if quirks:
        bench.devices[unit] = _movable(bench, device)
    elif unit == 0:
        bench.devices[unit] = AddressZeroDevice(device.settings, bench.line)


def _movable(bench: Bench, device: Device) -> MovableDevice:
    return MovableDevice(
        device.settings, bench.line, line_name="hall-a", line_source="", addresses=UnitAddresses(),
        change_rate=lambda baud: bench.line.change_rate(baud, bench.now), remember=lambda *_: None,
        emit=bench.events.append,
    )  # fmt: skip


def _read_settings(text: str) -> dict[str, Setting]:
    pairs = (each.split(" = ") for each in text.split(", "))
    return {key: _value(value) for key, value in pairs}


def _value(text: str) -> Setting:
    if text in ("true", "false"):
        return text == "true"
    if re.fullmatch(r"[\d.]+ m?s", text):
        return seconds(text)
    if re.fullmatch(r"\d+", text):
        return int(text)
    return float(text) if re.fullmatch(r"\d+\.\d+", text) else text
