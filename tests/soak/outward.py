"""What is seen of a gateway from outside while a world, or orders of the model, are played: one line of text for each.

    python -P tests/soak/outward.py lines --seed 1 --transactions 1000       # PYTHONPATH=CHECKOUT:CHECKOUT/tests

For `differential`, which compares two versions. Public borders are watched, whatever lies behind them: requests and
their answers, what clients get, what a line writes, hears and hands over, likewise an upstream, events, records of the
trace, and the status.
"""

import argparse
import asyncio
import random
import re
import sys
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import wraps
from importlib import import_module
from pathlib import Path
from typing import Any, Final

import anything

import gateway
from gateway.lines.line import Line
from gateway.ports.port import Port
from gateway.request import Request
from gateway.runtime.running import Running
from gateway.trace.ring import Ring
from gateway.upstreams.driver import TcpDriver
from kit.gateway_bench import Client, GatewayBench
from kit.line_bench import Bench
from kit.virtual_time import VirtualTimeLoop
from model import search
from model.letters import do, drain, enabled
from model.long_orders import LENGTHS
from model.settings import ALPHABETS, settings
from model.world import World
from soak.never_lies import WORLDS
from soak.outside import Socket
from soak.worlds import lines

#: The status is noted every so many virtual seconds.
STATUS_EVERY: Final = 10.0
#: A line that is woken so often while nothing is seen would be woken for ever.
MOST_WAKES: Final = 10_000
#: Times are compared to a microsecond.
LONG_NUMBER: Final = re.compile(r"\d+\.\d{7,}(?:e-\d+)?|\d(?:\.\d+)?e-\d+")


class _Playing:
    """What is being played: its virtual time, the gateway that is running, and how often lines woke since a note."""

    def __init__(self) -> None:
        self.time: Callable[[], float] = lambda: 0.0
        self.running: Running | None = None
        self.wakes = 0


playing = _Playing()


def note(text: str) -> None:
    """Write down what is seen now."""
    playing.wakes = 0
    text = LONG_NUMBER.sub(lambda number: f"{float(number[0]):.6f}", text)
    print(f"{playing.time():.6f}", text.replace("\n", "\\n"))


def watch(owner: type, name: str, tell: Callable[..., str]) -> None:
    """Note what `tell` makes of the arguments of each call of a method, before it is carried out."""
    original = getattr(owner, name)

    @wraps(original)
    def watched(self: Any, *args: Any, **kwargs: Any) -> Any:
        note(tell(self, *args, **kwargs))
        return original(self, *args, **kwargs)

    setattr(owner, name, watched)


def watch_result(owner: type, name: str, tell: Callable[[Any, Any], str]) -> None:
    """Note what `tell` makes of what each call of a method returns."""
    original = getattr(owner, name)

    @wraps(original)
    def watched(self: Any, *args: Any) -> Any:
        result = original(self, *args)
        note(tell(self, result))
        return result

    setattr(owner, name, watched)


# --- borders ---


def watch_lines(*, with_deadlines: bool) -> None:
    """Note what a line hears, writes and hands over, and what happens to its port; perhaps when it is to be woken."""
    watch(Line, "received", lambda line, data, now, **more: f"{_name(line)} << {data.hex(' ')} {more}")
    for name in ("port_down", "port_ended", "renew", "finish", "change_rate", "be_silent"):
        watch(Line, name, lambda line, *args, name=name, **more: f"{_name(line)} {name}")
    port_up = Line.port_up

    def port_up_and_note(line: Line, write: Callable[[bytes], None], *args: Any, **more: Any) -> None:
        def write_and_note(data: bytes) -> None:
            note(f"{_name(line)} >> {data.hex(' ')}")
            write(data)

        note(f"{_name(line)} port_up")
        port_up(line, write_and_note, *args, **more)

    Line.port_up = port_up_and_note
    keeper: Any = Line
    with suppress(ImportError):
        from gateway.lines.ledger import Ledger  # noqa: PLC0415 - earlier versions have none

        keeper = Ledger
    name = next(name for name in anything.HANDS_ON if hasattr(keeper, name))
    watch_result(keeper, name, lambda _, entries: f"hands on {sorted(map(_entry, entries))}")
    tick = Line.tick

    def tick_and_count(line: Line, now: float) -> None:
        playing.wakes += 1
        if playing.wakes > MOST_WAKES:
            sys.exit(f"{_name(line)} is woken again and again at {playing.time()} s")
        tick(line, now)

    Line.tick = tick_and_count
    if with_deadlines:
        watch(Line, "tick", lambda line, now: f"{_name(line)} tick")
        watch_result(Line, "deadline", lambda line, deadline: f"{_name(line)} is to be woken at {deadline}")


def watch_upstreams() -> None:
    """Note what an upstream hears and writes, and what happens to its connection."""
    watch(TcpDriver, "received", lambda driver, data, **more: f"{_upstream(driver)} << {data.hex(' ')}")
    watch(TcpDriver, "port_ended", lambda driver, _, *, at_once: f"{_upstream(driver)} port_ended {at_once}")
    watch(TcpDriver, "port_down", lambda driver, error: f"{_upstream(driver)} port_down {error}")
    port_up = TcpDriver.port_up

    def port_up_and_note(driver: TcpDriver, port: Port) -> None:
        note(f"{_upstream(driver)} port_up")
        port_up(driver, _Noted(port, lambda data: note(f"{_upstream(driver)} >> {data.hex(' ')}")))

    TcpDriver.port_up = port_up_and_note


class _Noted:
    """A port whose writing is noted before it is done."""

    def __init__(self, port: Port, note: Callable[[bytes], None]) -> None:
        self._port = port
        self._note = note

    def write(self, data: bytes) -> None:
        self._note(data)
        self._port.write(data)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._port, name)


def _upstream(driver: TcpDriver) -> str:
    return f"upstream {driver.upstream.settings.name}"


def _entry(each: Any) -> tuple[object, ...]:
    """What is handed on, in whichever version: unit, where answers come from, request, how many are owed until when."""
    asked = each.pdu if hasattr(each, "pdu") else each.asked.data
    return each.unit, str(each.answers_from), asked.hex(), each.owed, round(each.ends_at, 6)


def _name(line: Line) -> str:
    return f"line {line.settings.name}"


def _client(origin: Any) -> str:
    """Name a client, also in a checkout from before there were callers."""
    return str(getattr(origin, "caller", origin).client)


def watch_requests() -> None:
    """Note each request and its answer, what clients get, and what is kept for the trace."""

    def told(request: Request) -> str:
        return f"{_client(request.origin)}'s {request.unit}: {request.pdu.hex(' ')}"

    watch(Request, "respond", lambda request, pdu: f"{told(request)} is answered {pdu.hex(' ')}")
    watch(Request, "fail", lambda request, error: f"{told(request)} fails: {error!r}")
    watch(Request, "end", lambda request: f"{told(request)} ends")
    watch(
        Request,
        "__init__",
        lambda _, unit, pdu, origin, *rest: f"{_client(origin)} asks {unit}: {bytes(pdu).hex(' ')}",
    )
    watch(Client, "send", lambda client, data: f"{_client(client.session)} gets {data.hex(' ')}")
    watch(lines.Client, "send", lambda client, data: f"client {client._number} gets {data.hex(' ')}")
    watch(Socket, "write", lambda socket, data: f"a client over TCP gets {data.hex(' ')}")
    Ring.is_on = property(lambda ring: True)
    Ring.add = lambda ring, record: note(f"trace: {type(record).__name__} {list(_slots(record))}")
    Ring.add_failure = Ring.add


def _slots(each: object) -> Iterable[object]:
    return [getattr(each, slot) for kind in type(each).__mro__ for slot in getattr(kind, "__slots__", ())]


class _Events(list[Any]):
    def append(self, event: Any) -> None:
        note(f"event {event}")
        super().append(event)


def watch_gateways() -> None:
    """Note each event, and know which gateway is running."""

    def set_attribute(bench: object, name: str, value: object) -> None:
        object.__setattr__(bench, name, _Events(value) if name == "events" else value)

    def remember(running: Running, *_args: Any, **_kwargs: Any) -> str:
        playing.running = running
        return "a gateway starts"

    GatewayBench.__setattr__ = Bench.__setattr__ = set_attribute
    watch(Running, "__init__", remember)


# --- what is played ---


def status(running: Any, now: float) -> object:
    """The status of a gateway."""
    try:
        return import_module("kit.statuses").status(running)
    except ImportError:  # earlier versions have none
        return import_module("gateway.operator.status").status(running, now)


async def play_world(name: str, transactions: int, share: float, seed: int) -> None:
    """Play a world of `never_lies`."""
    loop = asyncio.get_running_loop()
    playing.time = loop.time

    def note_status() -> None:
        if playing.running is not None:
            running = playing.running
            asked = running if hasattr(running, "ring") else running.gateway  # as earlier versions have it
            note(f"{status(asked, loop.time())}")
        loop.call_later(STATUS_EVERY, note_status)

    loop.call_later(STATUS_EVERY, note_status)
    tally = await WORLDS[name](transactions, share, seed)
    note_status()
    note(str(tally))


class _World(World):
    """One of the model, whose time is that of what is noted."""

    def __init__(self, *args: Any) -> None:
        playing.time = lambda: getattr(self, "now", 0.0)
        super().__init__(*args)

    def _told(self, event: Any) -> None:
        note(f"event {event}")
        super()._told(event)


def _ended(world: World) -> None:
    drain(world)
    units = {unit: [str(each) for each in device.counts.values()] for unit, device in world.devices.items()}
    overheard = list(_slots(world.line.attribution.overheard))
    note(f"counts {units}, overheard {overheard}, unasked {world.line.unasked_bytes}, wrong: {world.wrong}")


def play_long_orders(count: int, seed: int) -> None:
    """Play random orders of the model."""
    dice, kinds = random.Random(seed), list(settings(*ALPHABETS))
    for _ in range(count):
        setting = dice.choice(kinds)
        note(f"--- {setting.name}")
        world = search.replay(setting)
        for _ in range(dice.choice(LENGTHS)):
            letter = dice.choice(enabled(world))
            note(letter)
            do(world, letter)
        _ended(world)


def play_orders(alphabet: str, file: Path) -> None:
    """Play the orders in a file."""
    kinds = list(settings(alphabet))
    for line in file.read_text().splitlines():
        number, *path = line.split("|")
        note(f"--- {kinds[int(number)].name}: {', '.join(path)}")
        _ended(search.replay(kinds[int(number)], tuple(path)))


def find_orders(alphabet: str, depth: int) -> None:
    """Print the orders that lead to each state of the model, as `every_order` finds them."""
    replay, path = search.replay, ()

    def remember(setting: Any, way: tuple[str, ...] = ()) -> World:
        nonlocal path
        path = way
        return replay(setting, way)

    search.replay = remember
    for number, setting in enumerate(settings(alphabet)):
        search.drain = lambda world, number=number: print(number, *path, sep="|")
        search.search(setting, depth)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("part", help="a world, `long`, `anything`, or an alphabet; `parts`: print them all")
    parser.add_argument("--transactions", type=int, default=1000)
    parser.add_argument("--faults", type=float, default=0.2)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--depth", type=int, help="print the orders of an alphabet, for --orders")
    parser.add_argument("--orders", type=Path)
    parser.add_argument("--deadlines", action="store_true")
    args = parser.parse_args()
    if not Path(gateway.__file__).is_relative_to(sys.path[0]):
        sys.exit(f"this is another gateway: {gateway.__file__}")
    if args.part == "parts":
        print(*WORLDS, "long", "anything", sep=",")
        print(*ALPHABETS, sep=",")  # one has words
        return
    if args.depth is not None:
        find_orders(args.part, args.depth)
        return
    random.seed(args.seed)
    search.World = _World
    watch_lines(with_deadlines=args.deadlines)
    watch_upstreams()
    watch_requests()
    watch_gateways()
    if args.part in WORLDS:
        with asyncio.Runner(loop_factory=VirtualTimeLoop) as runner:
            runner.run(play_world(args.part, args.transactions, args.faults, args.seed))
    elif args.part == "anything":
        anything.play(args.transactions // 20, args.seed, note, lambda time: setattr(playing, "time", time))
    elif args.part == "long":
        play_long_orders(args.transactions // 10, args.seed)
    else:
        play_orders(args.part, args.orders)


if __name__ == "__main__":
    main()
