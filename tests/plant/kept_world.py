"""Random lives of a publisher that keeps, in virtual time, and what must be true of each; see test_kept_walk.py.

A publisher, its history and its keeper are real, the file too. Devices, the broker, the disk's faults and the clock are
played. `python tests/plant/kept_world.py FIRST LAST` runs the seeds from FIRST to LAST.
"""

import asyncio
import json
import random
import sqlite3
import sys
import tempfile
from collections import Counter, defaultdict
from contextlib import suppress
from datetime import datetime
from pathlib import Path

import gateway.plant.kept.keeper as keeper_module
from gateway.plant.commands import CarriedOut
from gateway.plant.kept.file import KeptFile
from gateway.plant.kept.history import PAUSE, History
from gateway.plant.kept.keeper import FILE_NAME, Keeper
from gateway.plant.messages import Delivery, Message
from gateway.plant.plain import PlainForm
from gateway.plant.publisher import Publisher, PublisherSettings
from gateway.plant.sparkplug import Sparkplug
from gateway.plant.sparkplug_payload import DataType, Metric, Payload, decode, encode
from gateway.plant.topics import Topics
from gateway.profiles.point import Point
from gateway.profiles.published import PublishedDevice, PublishedPoint
from gateway.timing.clock_setting import ClockSetting
from kit.virtual_time import VirtualTimeLoop

BEGIN = 1_800_000_000.0
NOTHING = 65535
DEADBAND = 50
EVERY = 10.0

#: What may go wrong, as chances of a step; a life has one of these.
CALM = {"lose": 0.005, "connect": 0.02, "confirm": 0.9, "refuse": 0.0, "kill": 0.0, "stop": 0.0, "fault": 0.0}
CALM |= {"rebirth": 0.0, "damage": 0.0, "hang": 0.0, "step": 0.0, "reload": 0.0}
LIVES = {
    "calm": CALM,
    "outages": CALM | {"lose": 0.03, "connect": 0.03, "confirm": 0.5, "rebirth": 0.01, "reload": 0.005},
    "slow": CALM | {"lose": 0.01, "confirm": 0.1, "rebirth": 0.02},
    "refusals": CALM | {"lose": 0.01, "refuse": 0.1, "rebirth": 0.02, "confirm": 0.4},
    "stops": CALM | {"lose": 0.02, "stop": 0.02, "confirm": 0.4},
    "kills": CALM | {"lose": 0.02, "kill": 0.01, "stop": 0.005, "confirm": 0.4},
    "faults": CALM | {"lose": 0.02, "fault": 0.3, "confirm": 0.4, "hang": 0.01},
    "damage": CALM | {"lose": 0.02, "damage": 0.02, "confirm": 0.4, "fault": 0.1},
    "clock": CALM | {"lose": 0.02, "step": 0.01, "confirm": 0.6},
    "full": CALM | {"lose": 0.003, "connect": 0.002, "confirm": 0.3, "fault": 0.1},
    "bad disk": CALM | {"lose": 0.02, "kill": 0.01, "fault": 0.4, "confirm": 0.4},
}


def point(name: str, address: int, **options: object) -> PublishedPoint:
    return PublishedPoint(Point(name, "holding", address, invalid=(NOTHING,)), every=2.0, **options)


class Disk:
    """What the keeper calls in a thread: slow, at times failing, at times damaged or hanging."""

    def __init__(self, chance: random.Random, life: dict[str, float]) -> None:
        self.chance, self.life = chance, life
        self.is_damaged = False
        self.folder = Path()
        self.works_again = False
        self.files: list[KeptFile] = []

    def kill(self) -> None:
        """The process ends."""
        for each in self.files:
            each.close()
        self.files.clear()

    async def call(self, _purpose, call, *arguments):
        """Run a call as a thread would: it begins later, and its result is heard of later still."""
        await asyncio.sleep(self.chance.choice((0.0, 0.01, 0.05)))
        if not self.works_again and self.chance.random() < self.life["hang"]:
            await asyncio.sleep(40.0)
        name = getattr(getattr(call, "func", call), "__name__", "")
        if not self.works_again and name != "close" and self.chance.random() < self.life["fault"]:
            if name != "write" or self.chance.random() < 0.5:
                raise sqlite3.OperationalError("database or disk is full")
            database = call.__self__._database
            whole, writes = database.write, [0]

            def half(*rows: object) -> None:
                writes[0] += 1
                if writes[0] > 1:
                    raise sqlite3.OperationalError("disk I/O error")
                whole(*rows)

            database.write = half
            try:
                result = call(*arguments)
            finally:
                database.write = whole
        elif name in ("write", "after") and self.is_damaged:
            self.is_damaged = False
            call.__self__._database.close()
            for suffix in ("", "-wal"):
                file = self.folder / f"{FILE_NAME}{suffix}"
                if file.exists():
                    file.write_bytes(bytes(file.stat().st_size))
            raise sqlite3.DatabaseError("database disk image is malformed")
        else:
            result = call(*arguments)
            if name == "open":
                self.files.append(result[0])
        await asyncio.sleep(self.chance.choice((0.0, 0.01, 0.05)))
        return result


class World:
    """One life: what was read, what was told, and what the broker knows."""

    def __init__(self, seed: int, name: str, folder: Path, *, sparkplug: bool, steps: int) -> None:
        self.chance = random.Random(seed)
        self.life, self.name, self.folder, self.steps = LIVES[name], name, folder, steps
        self.is_sparkplug = sparkplug
        self.most_in_flight = self.chance.choice((1, 3, 20))
        self.largest = self.chance.choice((600, 1_000_000))
        self.most = 65536 if name == "full" else 2**22
        self.many = 12 if name == "full" else 1
        self.devices = tuple(
            PublishedDevice(
                f"d{unit}",
                unit,
                "p",
                (
                    point("count", 0),
                    point("wide", 1, on_change=DEADBAND),
                    *(point(f"more{each}", 2 + each) for each in range(self.many)),
                ),
            )
            for unit in range(3)
        )
        self.now = asyncio.get_running_loop().time
        self.offset = BEGIN
        self.setting = ClockSetting("boot", 0.0, is_set=name != "clock")
        self.kept_under: dict[tuple[str, str, float], set[ClockSetting]] = defaultdict(set)
        self.values: dict[str, list[int]] = {each.name: [1, 1000] + [1] * self.many for each in self.devices}
        self.alive = {each.name: True for each in self.devices}
        #: All readings of a point in order: (time, value).
        self.read: dict[tuple[str, str], list[tuple[float, object]]] = defaultdict(list)
        self.kept: Counter[tuple[str, str, float, object]] = Counter()
        self.young: list[tuple[float, tuple[str, str, float, object]]] = []
        #: What the broker has confirmed of live messages and births, and of history; what may have come.
        self.told: set[tuple[str, str, float, object]] = set()
        self.born: set[tuple[str, str, float, object]] = set()
        self.born_now: set[tuple[str, str, float, object]] = set()
        self.has_rebirths = self.life["rebirth"] > 0
        self.history: Counter[tuple[str, str, float, object]] = Counter()
        self.doubtful: Counter[tuple[str, str, float, object]] = Counter()
        self.excused: set[tuple[str, str, float, object]] = set()
        self.given_up = 0
        self.is_exact = not self.life["refuse"]
        self.last_write = 0.0
        self.in_order: dict[str, float] = {}
        self.live_time: dict[str, float] = {}
        self.in_flight: list[Message] = []
        self.facts: dict[int, list[tuple[str, str, float, object]]] = {}
        self.state_told: dict[str, list[tuple[str, str, float, object]]] = {}
        self.is_up = self.has_begun = False
        self.last_history = -1.0
        self.disk = Disk(self.chance, self.life)
        self.disk.folder = folder
        keeper_module.in_thread = self.disk.call
        self.start()

    # --- the gateway ---

    def start(self) -> None:
        self.keeper = Keeper(self.folder, self.most, EVERY, self.event, lambda: self.setting)
        keep = self.keeper._backlog.keep

        def kept(device, readings):
            for name, reading in readings.items():
                key = (device, name, reading.at, reading.value)
                self.kept[key] += 1
                self.kept_under[device, name, reading.at].add(self.setting)
                self.young.append((self.now(), key))
            keep(device, readings)

        self.keeper._backlog.keep = kept
        hold = self.keeper._backlog.hold

        def held(device, readings):
            for name, reading in readings.items():
                self.kept[device, name, reading.at, reading.value] += 1
                self.young.append((self.now(), (device, name, reading.at, reading.value)))
                self.kept_under[device, name, reading.at].add(self.setting)
            return hold(device, readings)

        self.keeper._backlog.hold = held
        self.publish()

    def publish(self) -> None:
        plain = PlainForm(Topics("plant", "modbus"), self.devices)
        form = Sparkplug("g", "n", self.devices) if self.is_sparkplug else plain
        history = History(self.keeper, form)
        born = history.born

        def told(device, readings):
            self.state_told[device] = [(device, name, each.at, each.value) for name, each in readings.items()]
            born(device, readings)

        history.born = told
        self.keeper.ready = history.look
        self.keeper.before_write = lambda: history.hold_slow(self.now())
        settings = PublisherSettings(self.devices, {each.name: 2.0 for each in self.devices}, "")
        self.publisher = Publisher(
            settings, form, None, None, self.event, self.now, lambda now: now + self.offset, CarriedOut(), history
        )

    def event(self, event) -> None:
        assert event.name != "part_failed", event

    # --- the plant ---

    def answer(self) -> None:
        """A device answers with some of its points, or does not."""
        device = self.chance.choice(self.devices)
        values = self.values[device.name]
        if self.chance.random() < 0.01:
            self.alive[device.name] = not self.alive[device.name]
        if not self.alive[device.name]:
            self.publisher.missed(device.name, self.now(), answers=False)
            return
        if self.chance.random() < 0.6:
            values[0] += 1
        for each in range(self.many):
            if self.chance.random() < 0.2 or self.many > 1:
                values[2 + each] += 1
        values[1] = max(100, min(60000, values[1] + self.chance.choice((0, 0, 3, -20, 70, -300))))
        points = self.chance.choice((device.points, device.points, device.points[:1], device.points[1:]))
        items = []
        for each in points:
            value = values[each.point.address]
            if each.name != "wide" and self.chance.random() < 0.03:
                value = NOTHING
            items.append((each.point, value.to_bytes(2)))
            value = None if value == NOTHING else value
            self.read[device.name, each.name].append((round(self.now() + self.offset, 3), value))
        self.publisher.took(device.name, items, self.now())

    # --- the broker ---

    def connect(self) -> None:
        self.publisher.will(self.now())
        self.publisher.connected(self.now())
        self.is_up, self.has_begun = True, False

    def lose(self) -> None:
        for message in self.in_flight:
            for fact in self.facts_of(message):
                self.doubtful[fact] += 1
        self.publisher.disconnected()
        self.in_flight = []
        self.born_now.clear()
        self.is_up = self.has_begun = False

    def is_history(self, message: Message) -> bool:
        if self.is_sparkplug:
            return "DDATA" in message.topic and any(each.is_historical for each in decode(message.payload).metrics)
        return message.topic.endswith("/history")

    def facts_of(self, message: Message) -> list[tuple[str, str, float, object]]:
        return self.facts[id(message)]

    def parse(self, message: Message) -> None:
        facts = []
        if self.is_history(message):
            device = message.topic.split("/")[-1 if self.is_sparkplug else -2]
            if self.is_sparkplug:
                facts = [(device, each.name, round(each.at, 3), each.value) for each in decode(message.payload).metrics]
            else:
                for record in json.loads(message.payload):
                    at = round(datetime.fromisoformat(record.pop("time")).timestamp(), 3)
                    unsure = record.pop("clock", None) == "unsure"
                    for name, value in record.items():
                        then = self.kept_under[device, name, at]
                        assert unsure == any(map(self.setting.differs, then)) or len(then) > 1, (at, unsure)
                        facts.append((device, name, at, value))
            self.judge_history(message, facts)
        elif message.birth and message.topic.split("/")[-1] != "availability":
            facts = self.state_told.get(message.device, [])
        elif message.told:
            facts = [(message.device, name, each.at, each.value) for name, each in message.told.items()]
            if not self.is_sparkplug:
                time = max(each.at for each in message.told.values())
                assert time >= self.live_time.get(message.device, 0.0) - 1e-6, "live times go backwards"
                self.live_time[message.device] = time
        self.facts[id(message)] = facts

    def judge_history(self, message: Message, facts) -> None:
        assert self.has_begun, "history before the birth is confirmed"
        assert not any(map(self.is_history, self.in_flight)), "two in flight"
        assert self.now() - self.last_history >= PAUSE - 1e-6, "too soon"
        assert message.payload
        assert not message.retain
        assert len(message.payload) < 40_000
        self.last_history = self.now()

    def take(self) -> None:
        if not self.is_up:
            return
        while len(self.in_flight) < self.most_in_flight:
            messages = self.publisher.take(self.now())
            if not messages:
                break
            for message in messages:
                self.parse(message)
                self.in_flight.append(message)
                self.facts[-id(message)] = [message]  # its identity stays its own
        if not self.has_begun and self.publisher.is_born and not self.publisher.has_birth and not self.in_flight:
            self.has_begun = True
            self.publisher.begin_history(self.now(), self.largest)

    def confirm(self) -> None:
        for _ in range(self.chance.randrange(4)):
            if not self.in_flight:
                return
            message = self.in_flight.pop(0)
            facts = self.facts_of(message)
            if self.chance.random() < self.life["refuse"]:
                is_passing = self.chance.random() < 0.7
                if is_passing:
                    self.doubtful.update(facts)
                elif not self.is_history(message):
                    self.excused.update(facts)
                self.publisher.refused(message, self.now(), is_passing=is_passing)
                continue
            if self.is_history(message):
                self.confirmed_history(facts)
            elif message.birth:
                self.born.update(facts)
                self.born_now.update(facts)
            else:
                self.told.update(facts)
            self.publisher.confirmed(message, self.now())

    def confirmed_history(self, facts) -> None:
        for fact in facts:
            device, name, at, value = fact
            assert self.was(device, name, at) == value, f"never so: {fact}"
            self.history[fact] += 1
            again = self.history[fact] + (fact in self.told) + (fact in self.born_now and not self.has_rebirths)
            again -= fact in self.born and self.has_rebirths  # only what the last birth has told is left out
            assert again <= max(1, self.kept[fact]) + self.doubtful[fact], f"told {again} times: {fact}"
            if not self.doubtful[fact]:
                assert at >= self.in_order.get(device, 0.0), f"out of order: {fact}"
                self.in_order[device] = at

    def was(self, device: str, name: str, at: float) -> object:
        """What a point was at that time: a message has the time of the latest of its readings."""
        return next((value for time, value in reversed(self.read[device, name]) if time <= at), "unknown")

    # --- what happens ---

    async def life_goes_on(self) -> None:
        for _ in range(self.steps):
            await asyncio.sleep(self.chance.choice((0.02, 0.1, 0.3)))
            self.answer()
            self.publisher.tick(self.now())
            happens = {what for what, chance in self.life.items() if self.chance.random() < chance}
            if "connect" in happens and not self.is_up:
                self.connect()
            if "lose" in happens and self.is_up:
                self.lose()
            if "rebirth" in happens and self.is_up:
                self.rebirth()
            self.take()
            if "confirm" in happens:
                self.confirm()
            if "damage" in happens:
                self.disk.is_damaged, self.is_exact = True, False
            if "step" in happens:
                self.step()
            if happens & {"stop", "kill", "reload"}:
                await self.end(happens)
            self.check()

    def rebirth(self) -> None:
        if self.is_sparkplug:
            metric = Metric("Node Control/Rebirth", value=True, data_type=DataType.BOOLEAN)
            payload = encode(Payload((metric,), 0.0), with_units=False)
            self.publisher.received(Delivery("spBv1.0/g/NCMD/n", payload, self.now()), self.now())
        elif self.publisher._births.may_begin(self.now()):
            self.publisher._be_born(self.now())

    def step(self) -> None:
        """Somebody sets the clock."""
        if self.setting.is_set:
            self.offset += 5.0
            self.setting = self.setting._replace(ahead=self.setting.ahead + 5.0)
        else:
            self.setting = self.setting._replace(is_set=True)

    async def end(self, happens: set[str]) -> None:
        if "kill" in happens:
            for device, watch in self.publisher.watches.items():
                self.excused |= {(device, name, each.at, each.value) for name, each in watch.waiting().items()}
            for message in self.in_flight:
                self.excused.update(self.facts_of(message))
            self.excused |= set(self.in_memory())
            if not self.life["fault"]:
                assert self.in_memory() <= {key for at, key in self.young if at >= self.now() - EVERY - 0.5}
            self.doubtful.update(list(self.kept) * 2)  # what the file still has comes again
            self.given_up += self.keeper.status.given_up
            self.in_flight, self.is_up, self.has_begun, self.is_exact = [], False, False, False
            self.keeper._task.cancel()
            self.disk.kill()
            await asyncio.sleep(0.7)
            self.start()
        elif self.is_up or "reload" not in happens:
            self.lose()
            if "stop" in happens:
                await self.keeper.close()
                assert not self.keeper.status.trouble
                self.given_up += self.keeper.status.given_up
                self.start()
            else:
                self.publish()

    def in_memory(self) -> set[tuple[str, str, float, object]]:
        """What is not in the file."""
        backlog = self.keeper._backlog
        return {
            (chunk.device, name, record.at, value)
            for chunk in (*backlog._closed, *backlog._open.values())
            if not chunk.is_over
            for record in chunk.records
            for name, value in record.values.items()
        }

    def check(self) -> None:
        status, backlog = self.keeper.status, self.keeper._backlog
        assert status.values >= 0
        assert backlog.in_memory >= 0
        assert backlog.in_file >= 0
        assert (status.since is None) == (status.values == 0), status
        if self.most == 65536:
            size = sum(file.stat().st_size for file in self.folder.iterdir() if FILE_NAME in file.name)
            assert size <= self.most, f"the file has {size} bytes"

    async def to_the_end(self) -> None:
        """The broker comes to stay, the disk works, and all is told."""
        self.disk.works_again = True
        self.life = CALM | {"confirm": 1.0, "connect": 1.0, "lose": 0.0}
        for device in self.alive:
            self.alive[device] = True
        for _ in range(4000):
            await asyncio.sleep(0.1)
            if not self.is_up:
                self.connect()
            for device in self.devices:
                items = [
                    (each.point, self.values[device.name][each.point.address].to_bytes(2)) for each in device.points
                ]
                at = round(self.now() + self.offset, 3)
                for each in device.points:
                    self.read[device.name, each.name].append((at, self.values[device.name][each.point.address]))
                self.publisher.took(device.name, items, self.now())
            self.take()
            self.confirm()
            is_open = self.keeper._file is not None and self.has_begun
            if is_open and not (self.in_flight or self.keeper.status.values or self.publisher.waiting):
                break
        self.judge()
        await self.keeper.close()

    def judge(self) -> None:
        status = self.keeper.status
        self.given_up += status.given_up
        assert (status.values, status.since) == (0, None), status
        assert self.keeper._backlog.in_memory == self.keeper._backlog.in_file == 0
        known = set(self.history) | self.told | self.born
        kept = list(self.kept.elements() if self.is_exact else self.kept)
        missing = [key for key in kept if key not in known and key not in self.excused]
        assert len(missing) <= self.given_up, f"{len(missing)} missing, {self.given_up} given up: {missing[:4]}"
        if self.is_exact:  # what is given up may have been told by a birth
            most = sum(key not in self.history and key not in self.excused for key in kept)
            assert self.given_up <= most, f"{most} missing in history, {self.given_up} given up: {missing[:4]}"
        known |= self.excused | set(self.kept)  # what was kept is judged above
        told = defaultdict(list)
        for device, name, at, value in known:
            told[device, name].append((at, value))
        for (device, name), readings in self.read.items():
            if name != "wide":
                self.every_change(device, name, readings, sorted(told[device, name], key=lambda each: each[0]))
            else:
                self.near(device, name, readings, sorted(told[device, name], key=lambda each: each[0]))

    @staticmethod
    def every_change(device, name, readings, told) -> None:
        """Each value was told with a time at which it was the value."""
        begin = 0
        for index in range(1, len(readings) + 1):
            if index < len(readings) and readings[index][1] == readings[begin][1]:
                continue
            value, since = readings[begin][1], readings[begin][0]
            until = readings[index][0] if index < len(readings) else float("inf")
            found = any(value == each and since <= at < max(until, since + 0.001) for at, each in told)
            assert found, f"never told: {device} {name} {value} from {since} to {until}"
            begin = index

    @staticmethod
    def near(device, name, readings, told) -> None:
        """What was told last before, or next, is near each value: a birth that is lost may have moved the deadband."""
        for at, value in readings:
            before = [each for time, each in told if time <= at][-1:]
            after = [each for time, each in told if time >= at][:1]
            near = any(abs(value - each) < 2 * DEADBAND for each in (*before, *after))
            assert near, f"never told: {device} {name} {value} at {at}; {before} {after}"


async def live(seed: int, name: str, folder: Path, *, sparkplug: bool, steps: int = 400) -> World:
    """Live one life, and judge it."""
    world = World(seed, name, folder, sparkplug=sparkplug, steps=steps)
    await world.life_goes_on()
    await world.to_the_end()
    return world


def run(seed: int, *, steps: int = 400) -> None:
    """Run all lives of a seed."""
    for name in LIVES:
        for sparkplug in (False, True):
            run_one(seed, name, sparkplug=sparkplug, steps=steps)


def run_one(seed: int, name: str, *, sparkplug: bool, steps: int = 400) -> None:
    """Run one life."""
    with tempfile.TemporaryDirectory(dir="/dev/shm" if Path("/dev/shm").is_dir() else None) as folder:
        loop, in_thread = VirtualTimeLoop(), keeper_module.in_thread
        try:
            loop.run_until_complete(live(seed, name, Path(folder), sparkplug=sparkplug, steps=steps))
        except BaseException as error:
            error.add_note(f"seed {seed}, {name}, {'Sparkplug' if sparkplug else 'plain'}")
            raise
        finally:
            for task in asyncio.all_tasks(loop):
                task.cancel()
                with suppress(asyncio.CancelledError):
                    loop.run_until_complete(task)
            loop.close()
            keeper_module.in_thread = in_thread


if __name__ == "__main__":
    for each in range(int(sys.argv[1]), int(sys.argv[2]) + 1):
        run(each)
