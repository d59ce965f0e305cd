"""What `check` prints is what runs (P20): files made at random, each that it accepts as a whole gateway in memory."""

import asyncio
import io
import json
from collections.abc import Iterator, Sequence
from contextlib import closing, redirect_stdout
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pytest
from hypothesis import assume, given

from gateway.cli.main import main
from gateway.config.values.unitset import parse_units
from gateway.devices.device import DeviceSettings
from gateway.errors import RequestError
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.codes import Area
from gateway.modbus.frame import Frame
from gateway.modbus.pdu import Span, exception_response
from gateway.profiles.profile import Profile
from gateway.routing.access import EVERYTHING, AccessRow
from gateway.routing.rights import Rights
from gateway.timing.characters import LineTiming
from kit.asking import ask
from kit.configs import accepted_configs
from kit.device import Answer
from kit.gateway_bench import Client, GatewayBench, keep_lines_open
from kit.memory import MemoryLine
from kit.statuses import status
from kit.virtual_time import VirtualTimeLoop

NO_ROUTE, BUSY, STALE = 0x0A, 0x06, 0x0B
#: What a listener says that stays silent about failures.
NOTHING = b""
#: So many units of a file are asked, and so many that it does not have.
MOST_ASKED, UNKNOWN_ASKED = 10, 3
#: An answer may be later by so much than what `check` prints as the longest wait (P3).
MORE = 0.02
#: A device's answer behind the end of the request, in seconds.
QUICK = 0.0005
#: A test waits no longer, whatever is printed: a `gap` may be of days; or if somebody may stay silent.
LONG, PATIENCE = 60.0, 10.0

READS = {1: Area.COILS, 2: Area.DISCRETE, 3: Area.HOLDING, 4: Area.INPUT}


class Place(NamedTuple):
    """A unit on a wire, or behind another server."""

    port: str
    unit: int


class Everybody:
    """A device at each address of a wire, in whose registers and coils its place can be read. `heard` is all it got."""

    def __init__(self, number: int, timing: LineTiming | None = None, *, echo: bool = False) -> None:
        self.heard: list[tuple[int, bytes]] = []
        self._number = number
        self._timing = timing
        self._echo = echo
        is_ascii = timing is not None and timing.mode == "ascii"
        self._framer = ascii_framing.AsciiFramer() if is_ascii else rtu.RtuFramer(silence=0.0)
        self._encode = ascii_framing.encode if is_ascii else rtu.encode

    def received(self, data: bytes, now: float) -> list[Answer]:
        """See SimulatedLine."""
        if self._timing is None:
            adus = list(mbap.MbapFramer().cut(data))
            self.heard += [(adu.unit, adu.pdu) for adu in adus]
            return [Answer(0.0, mbap.encode(adu.transaction, adu.unit, self.says(adu.unit, adu.pdu))) for adu in adus]
        frames = self._framer.received(data, now) + self._framer.tick(now)
        self.heard += frames
        return [answer for frame in frames for answer in self._answers(frame, data, self._timing)]

    def _answers(self, frame: Frame, data: bytes, timing: LineTiming) -> Iterator[Answer]:
        sent = timing.frame(len(frame.pdu))
        if self._echo:
            yield Answer(sent, data)
        response = self.says(frame.unit, frame.pdu)
        yield Answer(sent + QUICK, self._encode(frame.unit or 99, response))

    def says(self, unit: int, pdu: bytes) -> bytes:
        """What `unit` answers: a number of the wire and its own, as often as there is room, or exception 04."""
        if pdu[0] not in READS:
            return exception_response(pdu[0], 4)
        items = int.from_bytes(pdu[3:5])
        bits = 16 * items if READS[pdu[0]] in {Area.HOLDING, Area.INPUT} else items
        values = int.from_bytes((bytes((unit, self._number)) * bits)[: bits // 8 + 1], "little") % 2**bits
        data = values.to_bytes((bits + 7) // 8, "little")
        return bytes((pdu[0], len(data))) + data


class Printed:
    """What `check` prints of a file."""

    def __init__(self, picture: dict[str, Any]) -> None:
        self.picture = picture
        #: Who answers for each unit that clients use, and which place each device's name stands for.
        self.devices: dict[int, Place] = {}
        #: Those that have a name only.
        self.named: dict[str, Place] = {}
        self.images = {one["unit"]: one["name"] for one in picture["images"]}
        self.mirrors = {one["unit"]: one["of"] for one in picture["mirrors"]}
        self.virtual = {one["unit"]: one["map"] for one in picture["virtual_units"]}
        self.places: dict[str, Place] = {}
        self.waits: dict[Place | None, float] = {}
        for unit, name, place in self._all_devices():
            assert unit not in self.units, f"unit {unit} is printed twice"
            assert name not in self.places, f"{name} is printed twice"
            self.places[name] = place
            if unit is None:
                self.named[name] = place
            else:
                self.devices[unit] = place
        for line in picture["lines"]:
            if line["passes_through"]:  # mirrors, and listeners for this line, may be in front of units there
                wait = max((row["longest_wait_ms"] / 1000 for row in line["units"]), default=LONG)
                for unit in parse_units(line["addresses"].split(", ")):
                    self.places[f"{line['name']}/{unit}"] = Place(line["port"], unit)
                    self.waits[Place(line["port"], unit)] = wait
        self._check_names()

    def _check_names(self) -> None:
        """Each name means one unit, and so does each number."""
        kinds = ("images", "mirrors", "virtual_units")
        others = [(one["unit"], one["name"]) for kind in kinds for one in self.picture[kind]]
        names = [*self.places, *(name for _, name in others)]
        assert len(set(names)) == len(names), f"one of {names} is printed twice"
        for unit, name in (*((unit, name) for unit, name, _ in self._all_devices()), *others):
            assert not name.isdecimal() or int(name) == unit, f"unit {unit} is called {name}"

    @property
    def units(self) -> dict[int, Any]:
        return self.devices | self.images | self.mirrors | self.virtual

    def _all_devices(self) -> Iterator[tuple[int | None, str, Place]]:
        for line in self.picture["lines"]:
            for row in line["units"]:
                if row["unit"] is None:
                    place = Place(line["port"], int(row["on_the_wire"]))
                    self.waits[place] = row["longest_wait_ms"] / 1000
                    yield None, row["device"], place
            for row in line["units"] if line["shared"] else ():
                if row["unit"] is None:
                    continue
                units = parse_units(row["unit"].split(", "))
                on_the_wire = units if row["on_the_wire"] == "same" else [int(row["on_the_wire"])]
                for unit, wire_unit in zip(units, on_the_wire, strict=True):
                    name = row["device"] if len(units) == 1 else f"{line['name']}/{unit}"
                    place = Place(line["port"], wire_unit)
                    self.waits[place] = row["longest_wait_ms"] / 1000
                    yield unit, name, place
        for upstream in self.picture["upstreams"]:
            for row in upstream["units"]:
                unit = None if row["unit"] is None else int(row["unit"])
                place = Place(upstream["to"], int(row["behind_the_server"]))
                self.waits[place] = row["longest_wait_ms"] / 1000
                yield unit, row["device"], place


def contested(devices: Sequence[DeviceSettings]) -> set[int]:
    """The addresses that two devices have, if one of them can change its address."""
    of = {unit: [each for each in devices if each.unit == unit] for unit in {each.unit for each in devices}}
    return {unit for unit, there in of.items() if len(there) > 1 and any(each.profile.quirks for each in there)}


class Scene:
    """A running gateway, everybody on its wires, and what was printed of it."""

    def __init__(self, bench: GatewayBench, printed: Printed) -> None:
        self.bench = bench
        self.printed = printed
        self.enter(0)
        self.everybody: dict[str, Everybody] = {}
        plan = bench.gateway.plan
        wires = [(one.port.port, one.line.timing, one.line.echo) for one in plan.lines]
        wires += [(one.port.port, None, False) for one in plan.upstreams]
        for number, (port, timing, echo) in enumerate(wires, start=1):
            self.everybody[port] = Everybody(number, timing, echo=echo)
            name = port.removeprefix("/dev/")
            bench.lines.setdefault(name, MemoryLine(port, latency=0.005))
            bench.attach(name, self.everybody[port])
        for server in plan.servers:
            port = server.port.port
            line = MemoryLine(port, latency=0.005)
            line = bench.lines.setdefault(port.removeprefix("/dev/"), line)
            line.on_write = line.deliver if server.line.echo else None
        behind = [device for line in plan.lines for device in line.shared]
        behind += [device for upstream in plan.upstreams for device in upstream.devices]
        self.profiles = {device.known_as: device.profile for device in behind}
        self.lines = {one.line.name: one for one in plan.lines}
        #: Addresses of several devices, of which one can move: none of them is asked, as `check` says.
        self._contested = {Place(line.port.port, unit) for line in plan.lines for unit in contested(line.devices)}

    def enter(self, listener: int) -> None:
        """From now on clients come by this listener."""
        self._listener, self._unit0 = listener, None

    def stand_in(self, unit: int) -> None:
        """From now on they ask unit 0 when they mean this one."""
        self._unit0 = unit

    def allow_everything(self) -> None:
        for each in (*self.bench.gateway.listeners, *self.bench.gateway.servers):
            row = AccessRow(EVERYTHING, listeners=frozenset({each.router.entry.name}))
            each.router.rights = Rights((row,), each.router.entry)

    async def check_unit(self, unit: int) -> None:
        """Who answers for `unit` is who was printed."""
        printed = self.printed
        if unit in printed.devices:
            await self._check_device(unit, printed.devices[unit], self.profiles[unit])
        elif unit in printed.mirrors:
            await self._check_mirror(unit, printed.places[printed.mirrors[unit]])
        elif unit in printed.virtual:
            await self._check_virtual(unit, printed.virtual[unit])
        else:
            await self._check_image(unit, printed.images[unit])

    async def check_name(self, name: str) -> None:
        """Who answers for a device without a unit is who was printed, by its name at the control socket."""
        place = self.printed.named[name]
        plan = self.bench.gateway.plan
        owners = (*plan.lines, *plan.upstreams)
        profile = next(each.profile for one in owners for each in one.devices if each.name == name)
        self._nothing_was_heard()
        pdu = question(profile)
        if pdu is not None:
            answer = await ask(self.bench.running, "request", unit=name, pdu=pdu.hex())
            await self._check_answer(bytes.fromhex(answer["pdu"]), pdu, place)

    async def check_line(self, name: str) -> None:
        """What a listener for one line leads to: addresses on the wire."""
        (line,) = (one for one in self.printed.picture["lines"] if one["name"] == name)
        profiles = {device.unit: device.profile for device in reversed(self.lines[name].devices)}
        addresses = parse_units(line["addresses"].split(", ")) if line["addresses"] else ()
        for address in addresses[:MOST_ASKED]:
            await self._check_device(address, Place(line["port"], address), profiles[address])
        for unit in [unit for unit in range(1, 256) if unit not in addresses][-UNKNOWN_ASKED:]:
            await self.check_unknown(unit)

    async def check_upstream(self, name: str) -> None:
        """What a listener for one upstream leads to: all units of that server."""
        (upstream,) = (one for one in self.printed.picture["upstreams"] if one["name"] == name)
        (plan,) = (one for one in self.bench.gateway.plan.upstreams if one.name == name)
        profiles = {device.unit: device.profile for device in (*plan.unnamed, *plan.devices)}
        named = [int(row["behind_the_server"]) for row in upstream["units"]]
        (plan,) = (one for one in self.bench.gateway.plan.upstreams if one.upstream.name == name)
        profiles = {device.unit: device.profile for device in (*plan.unnamed, *reversed(plan.devices))}
        for unit in dict.fromkeys([*named[:MOST_ASKED], *range(0, 256, 51)]):
            place = Place(upstream["to"], unit)
            self.printed.waits[place] = upstream["longest_wait_ms"] / 1000
            await self._check_device(unit, place, profiles[unit])

    async def check_served(self, server: dict[str, Any], unit: int) -> None:
        """What the outside client of a server line gets from `unit`, if it is there in time."""
        place = self.printed.devices.get(unit)
        pdu = None if place is None else question(self.profiles[unit])
        if pdu is None:
            return
        encode = ascii_framing.encode if server["mode"] == "ascii" else rtu.encode
        line = self.bench.lines[server["port"].removeprefix("/dev/")]
        line.deliver(encode(unit, pdu))
        await asyncio.sleep(PATIENCE)
        right = self.everybody[place.port].says(place.unit, pdu)
        assert line.take_written() in {b"", encode(unit, right), encode(unit, exception_response(pdu[0], BUSY))}

    async def check_unknown(self, unit: int) -> None:
        assert await self.ask(unit, bytes.fromhex("0300000001")) in {NOTHING, exception_response(3, NO_ROUTE)}

    async def ask(self, unit: int, pdu: bytes, place: Place | None = None) -> bytes:
        """The response, which comes within the longest wait that was printed for `place`, or at once."""
        self._nothing_was_heard()
        client = Client(self.bench.gateway, listener=self._listener)
        client.ask(0 if unit == self._unit0 else unit, pdu.hex())
        is_silent = self.printed.picture["listeners"][self._listener]["on_failure"] == "silent"
        longest = self.printed.waits.get(place, 0.0)
        wait = min(longest, PATIENCE if is_silent else LONG) + MORE
        try:
            async with asyncio.timeout(wait):
                _, _, response = await client.responses.get()
        except TimeoutError:
            if is_silent or longest > LONG:
                return NOTHING
            raise
        return bytes.fromhex(response)

    def _nothing_was_heard(self) -> None:
        for one in self.everybody.values():
            one.heard.clear()

    async def _check_device(self, unit: int, place: Place, profile: Profile) -> None:
        pdu = question(profile)
        if pdu is None:
            return
        await self._check_answer(await self.ask(unit, pdu, place), pdu, place)

    async def _check_answer(self, response: bytes, pdu: bytes, place: Place) -> None:
        if response in {NOTHING, exception_response(pdu[0], BUSY)}:
            return
        if place in self._contested and response == exception_response(pdu[0], NO_ROUTE):
            return
        assert response == self.everybody[place.port].says(place.unit, pdu)
        if pdu[0] not in READS:
            heard = {
                Place(port, unit) for port, one in self.everybody.items() for unit, each in one.heard if each == pdu
            }
            assert heard == {place}

    async def _check_mirror(self, unit: int, place: Place) -> None:
        (mirror,) = (one for one in self.bench.gateway.plan.mirrors if one.unit == unit)
        area, ranges = next((area, ranges) for area, ranges in mirror.areas.items() if ranges)
        function = next(function for function, each in READS.items() if each is area)
        items = 16 if area in {Area.COILS, Area.DISCRETE} else 1
        pdu = bytes((function, *ranges[0][0].to_bytes(2), *min(items, ranges[0][1] + 1 - ranges[0][0]).to_bytes(2)))
        response = await self.ask(unit, pdu, place)
        if response != exception_response(function, STALE):  # on a busy line values may be too old
            await self._check_answer(response, pdu, place)

    async def _check_virtual(self, unit: int, printed: list[dict[str, Any]]) -> None:
        """Each row of registers, or of coils, as they are has those that were printed."""
        (virtual,) = (one for one in self.bench.gateway.plan.virtual if one.unit == unit)
        for row in printed:
            place = self.printed.places.get(row["device"])
            if row["what"] != "value" or row["point"] or row["swap"] or place is None or place in self._contested:
                continue
            area, _, addresses = row["there"].partition(" ")
            pdu = _read(row["area"], row["first"], row["last"] + 1 - row["first"])
            there = _read(area, int(addresses.partition("-")[0]), row["last"] + 1 - row["first"])
            if passes(virtual.profile, pdu):
                response = await self.ask(unit, pdu, place)
                if response not in {NOTHING, exception_response(pdu[0], STALE)}:
                    assert response == pdu[:1] + self.everybody[place.port].says(place.unit, there)[1:]

    async def _check_image(self, unit: int, name: str) -> None:
        before = self._requests_of(name)
        await self.ask(unit, bytes.fromhex("0300000001"))
        assert self._requests_of(name) == before + 1

    def _requests_of(self, name: str) -> int:
        (image,) = (one for one in status(self.bench.running).images if one.name == name)
        return image.requests


def question(profile: Profile) -> bytes | None:
    """A request that the profile lets pass, best one whose answer shows who gave it: of registers with two bytes."""
    starts = {area: [first for first, _ in profile.areas.get(area, ((0, 0xFFFF),))] for area in Area}
    reads = [
        bytes((function, *start.to_bytes(2), 0, 1 if function > 2 else 16))
        for function in (3, 4, 1, 2)
        for start in starts[READS[function]]
        if not profile.has_wide(Span(READS[function], start, 1))
    ]
    others = [bytes((function, 0, 0, 0, 0)) for function in sorted(profile.functions or ())]
    others += [bytes((function,)) for function in sorted(profile.functions or ())]
    return next((pdu for pdu in (*reads, *others) if passes(profile, pdu)), None)


def _read(area: str, first: int, count: int) -> bytes:
    function = next(function for function, each in READS.items() if each == area)
    return bytes((function, *first.to_bytes(2), *count.to_bytes(2)))


def passes(profile: Profile, pdu: bytes) -> bool:
    try:
        profile.check(pdu)
    except RequestError:
        return False
    return True


def check(text: str, folder: Path) -> Printed:
    file = folder / "gateway.toml"
    file.write_text(text)
    said = io.StringIO()
    with redirect_stdout(said):
        assert main(["check", "--json", str(file)]) == 0
    return Printed(json.loads(said.getvalue()))


async def check_listener(scene: Scene, listener: dict[str, Any]) -> None:
    """All that a listener leads to which is not for one line or upstream."""
    units = list(scene.printed.units)
    for unit in units[:MOST_ASKED]:
        await scene.check_unit(unit)
    for unit in [unit for unit in range(1, 256) if unit not in units][-UNKNOWN_ASKED:]:
        await scene.check_unknown(unit)
    if isinstance(listener["unit0"], int):
        scene.stand_in(listener["unit0"])
        await scene.check_unit(listener["unit0"])


async def run(text: str, printed: Printed, folder: Path) -> None:
    with closing(GatewayBench(text, state=folder)) as bench:
        scene = Scene(bench, printed)
        async with keep_lines_open(bench.running):
            await asyncio.sleep(1.0)
            await check_everything(scene)


async def check_everything(scene: Scene) -> None:
    scene.allow_everything()
    for number, listener in enumerate(scene.printed.picture["listeners"]):
        scene.enter(number)
        if listener["line"]:
            await scene.check_line(listener["line"])
        elif listener["upstream"]:
            await scene.check_upstream(listener["upstream"])
        else:
            await check_listener(scene, listener)
    for name in [*scene.printed.named][:MOST_ASKED]:
        await scene.check_name(name)
    for server in scene.printed.picture["servers"]:
        for row in server["units"]:
            await scene.check_served(server, row["unit"])


@pytest.fixture(scope="module", autouse=True)
def _nothing_is_remembered(tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(tmp_path_factory.mktemp("state")))
        yield


@given(accepted_configs())
def test_each_unit_leads_where_check_says(text):
    with TemporaryDirectory() as folder:
        printed = check(text, Path(folder))
        ports = [one["to"] for one in printed.picture["upstreams"]]
        assume(len(set(ports)) == len(ports))  # two connections to one server: that is one wire here
        with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
            runner.run(run(text, printed, Path(folder)))
