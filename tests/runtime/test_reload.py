"""A reload in virtual time: what has changed is exchanged, what has not is not touched."""

import asyncio
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from functools import partial
from pathlib import Path

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.errors import ListenError, Unready
from gateway.events import ConfigApplied, ConfigRejected, ConfigWarning, LineLost, LineUp, PartFailed
from gateway.modbus import mbap
from gateway.modbus.codes import Area
from gateway.modbus.mbap import TcpFrame
from gateway.modbus.rtu import encode
from gateway.readconfig.process import READING_TIME, ConfigRead
from gateway.routing.access import READING
from gateway.runtime import build
from gateway.runtime.fleet.add_on import Fleet
from gateway.runtime.reload import Outcome, Reloader
from gateway.service.supervisor import Stop, serve
from gateway.service.systemd import Notifier
from images.disk import MemoryFiles
from kit.asking import ask
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import GatewayBench

LISTEN = """
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:5020"
"""
HALL_A = """
[[line]]
name = "hall-a"
port = "/dev/hall-a"
devices = [{ unit = 1, as = 41, name = "silo" }]
"""
HALL_B = """
[[line]]
name = "hall-b"
port = "/dev/hall-b"
timeout = "500 ms"
devices = [{ unit = 2 }]
"""
IMAGE = """
[[image]]
unit = 200
name = "shift"
holding = 10
"""
SERVER = """
[[line]]
name   = "panel"
port   = "/dev/panel"
role   = "server"
serves = 41
"""
READ, WRITE = "03 00 00 00 01", "06 00 00 00 07"


class Doors:
    """Stands for a listener, which has its own tests: virtual time knows no sockets."""

    address = "tcp://127.0.0.1:5020"
    clients = 0
    has_clients = False
    sockets = ()

    def __init__(self, listener) -> None:
        self.settings = listener.settings
        self.router = listener.router
        self.told: list[str] = []

    async def find(self) -> None:
        self.told.append("find")

    def bind(self, ready=None) -> None:
        self.told.append("bind")

    def listen(self) -> None:
        self.told.append("listen")

    def start(self) -> None:
        self.told.append("start")

    def finish(self) -> None:
        self.told.append("finish")

    def close(self) -> None:
        self.told.append("close")


class Service:
    """A gateway that serves the config in `file`."""

    def __init__(self, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
        self._make_listener = build._listener
        monkeypatch.setattr("gateway.runtime.build._listener", self._doors)
        self.file = file
        self.bench = GatewayBench(file.read_text(), state=file.parent)
        self.events = self.bench.events
        self.running = self.bench.running
        #: An entry for each time that the collector is told to settle.
        self.settled: list[None] = []
        settle = partial(self.settled.append, None)
        self.reloader = Reloader(file, self.running, Notifier({}), read=self._read, settle=settle)
        self.stop = Stop()
        for number, port in ((1, "hall-a"), (2, "hall-b")):
            self.attach(port, number)

    def attach(self, port: str, number: int) -> None:
        self.bench._open(type("Settings", (), {"port": f"/dev/{port}", "latency": 0.0, "listens": False})())
        self.bench.attach(port, SimulatedLine("rtu", SimulatedDevice(number, delay=0.01)))

    async def reload(self, config: str) -> Outcome:
        self.file.write_text(config)
        return await self.reloader.order()

    def part(self, name: str):
        return next(part for part in self.running.gateway.parts if part.name == name)

    def client(self):
        self.bench.gateway = self.running.gateway
        return self.bench.client()

    def _doors(self, settings, loop, emit, ring, contexts):
        return Doors(self._make_listener(settings, loop, emit, ring, contexts))

    @staticmethod
    def _read(file):
        loaded = parse(file.read_text(), str(file), port_trouble=lambda port: None, real_path=lambda port: port)
        return ConfigRead(loaded.config and resolve(loaded.config), loaded.problems)


@pytest.fixture
def serving(tmp_path, monkeypatch):
    @asynccontextmanager
    async def serve_config(config: str) -> AsyncIterator[Service]:
        file = tmp_path / "gateway.toml"
        file.write_text(config)
        service = Service(file, monkeypatch)
        task = asyncio.create_task(serve(service.running, service.stop, reloader=service.reloader), name="serve")
        await service.running.ready.wait()
        await asyncio.sleep(1.0)
        yield service
        service.stop.order("the test ends")
        await task

    return serve_config


async def test_who_reloads_is_told_which_file(serving):
    async with serving(LISTEN + HALL_A) as service:
        answer = await ask(service.running, "reload", reloader=service.reloader)
        assert (answer["ok"], answer["file"]) == (True, str(service.file.absolute()))


async def test_a_reload_that_takes_long_is_not_waited_for_and_goes_on(serving):
    async with serving(LISTEN + HALL_A) as service:
        service.running.ready.clear()
        with pytest.raises(Unready, match="the reload has not ended within 85 s; the log says what becomes of it"):
            await ask(service.running, "reload", reloader=service.reloader)
        service.running.ready.set()
        await asyncio.sleep(1.0)
        assert service.reloader.last.outcome == Outcome()


async def test_a_file_that_means_the_same_changes_nothing(serving):
    async with serving(LISTEN + HALL_A + HALL_B + IMAGE) as service:
        before = service.running.gateway
        outcome = await service.reload("# moved down\n\n" + LISTEN + HALL_A + HALL_B + IMAGE)
        after = service.running.gateway
        assert outcome == Outcome()
        assert (after.parts, after.images, after.listeners) == (before.parts, before.images, before.listeners)
        assert service.part("hall-a").devices[41].source.endswith(":11")


async def test_what_it_leaves_behind_is_freed(serving):
    async with serving(LISTEN + HALL_A) as service:
        await service.reload(LISTEN + HALL_B)
        assert len(service.settled) == 1


async def test_what_has_changed_is_built_anew_and_the_rest_is_not_touched(serving):
    async with serving(LISTEN + HALL_A + HALL_B + IMAGE) as service:
        client = service.client()
        hall_a, hall_b = service.part("hall-a"), service.part("hall-b")
        outcome = await service.reload(LISTEN + HALL_A + HALL_B.replace("500 ms", "400 ms") + IMAGE)
        assert outcome == Outcome(changed=("line hall-b",))
        assert service.part("hall-a") is hall_a
        assert service.part("hall-b") is not hall_b
        await asyncio.sleep(1.0)
        assert await client.asks(41, READ) == "03 02 00 00"
        assert await client.asks(2, READ) == "03 02 00 00"
        assert [event for event in service.events if isinstance(event, LineUp)].count(
            LineUp("hall-a", "/dev/hall-a")
        ) == 1


@pytest.mark.parametrize(("key", "is_kept"), [("serves = [41, 200]", True), ('serves = 41\ngap = "9 ms"', False)])
async def test_a_server_line_that_serves_others_stays_open(serving, key, is_kept):
    config = LISTEN + HALL_A + IMAGE + SERVER
    async with serving(config) as service:
        panel = service.part("panel")
        await service.reload(config.replace("serves = 41", key))
        assert (service.part("panel") is panel) is is_kept
        now = service.part("panel")
        assert set(now.router.routes) == {0, 41, 200} if is_kept else {0, 41}
        assert now.driver.session.settings.serves == now.plan.line.serves


async def test_open_connections_take_the_new_routes(serving):
    async with serving(LISTEN + HALL_A + IMAGE) as service:
        client = service.client()
        assert await client.asks(201, READ) == "83 0A"
        outcome = await service.reload(LISTEN + HALL_A + IMAGE.replace("200", "201").replace("shift", "day") + HALL_B)
        assert outcome == Outcome(added=("line hall-b", "image day"), removed=("image shift",))
        await asyncio.sleep(1.0)
        assert await client.asks(201, READ) == "03 02 00 00"
        assert await client.asks(200, READ) == "83 0A"
        assert await client.asks(2, READ) == "03 02 00 00"


async def test_open_connections_take_the_new_rights(serving):
    async with serving(LISTEN + HALL_A + SERVER) as service:
        client, panel = service.client(), service.part("panel").router
        assert await client.asks(41, WRITE) == WRITE
        outcome = await service.reload(LISTEN + HALL_A + SERVER + '[[access]]\nlisten = ["panel"]\nallow = ["read"]\n')
        assert outcome == Outcome(changed=("access",))
        assert await client.asks(41, WRITE) == "86 01"
        assert await client.asks(41, READ) == "83 01"
        assert service.part("panel").router is panel
        assert panel.rights[""][41] == READING
        await service.reload(LISTEN + HALL_A + SERVER)
        assert await client.asks(41, WRITE) == WRITE


async def test_a_line_that_goes_finishes_what_is_on_the_wire_and_refuses_what_waits(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        client = service.client()
        client.ask(2, READ)
        client.ask(2, "04 00 00 00 01")
        await asyncio.sleep(0.005)
        outcome = await service.reload(LISTEN + HALL_A)
        assert outcome == Outcome(removed=("line hall-b",))
        assert [await client.answer(), await client.answer()] == ["84 0A", "03 02 00 00"]
        assert not service.bench.lines["hall-b"].is_open


@pytest.mark.parametrize(
    "config",
    ["[[line]\n", "x = 1\n", LISTEN + HALL_A + HALL_A.replace('"hall-a"', '"c"'), LISTEN + '[[line]]\nport = ""\n'],
)
async def test_a_broken_file_leaves_the_old_one_in_force(serving, config):
    async with serving(LISTEN + HALL_A) as service:
        before = service.running.gateway
        outcome = await service.reload(config)
        assert outcome.problems
        assert service.running.gateway is before
        assert await service.client().asks(41, READ) == "03 02 00 00"
        assert [type(event) for event in service.events].count(ConfigRejected) == 1


async def test_the_log_names_the_first_error_in_one_line_whatever_was_warned_of(serving):
    async with serving(LISTEN + HALL_A) as service:
        config = LISTEN.replace("127.0.0.1", "0.0.0.0") + HALL_A + '[[image]]\nname = "a"\n[[image]]\nname = "b"\n'
        outcome = await service.reload(config)
        assert [" error: " in problem for problem in outcome.problems] == [True, True]
        rejected = next(event for event in service.events if isinstance(event, ConfigRejected))
        assert rejected.reason == outcome.problems[0].splitlines()[0] + " (and 1 more)"


async def test_a_file_that_cannot_be_read_to_its_end_holds_up_no_later_reload(serving, monkeypatch):
    async with serving(LISTEN + HALL_A) as service:
        loop = asyncio.get_running_loop()
        with monkeypatch.context() as hanging:
            hanging.setattr(loop, "run_in_executor", lambda *arguments: loop.create_future())
            first = service.reloader.order()
            await asyncio.sleep(1.0)
        began = loop.time()
        second = await service.reload(LISTEN + HALL_A + HALL_B)
        assert second == Outcome(added=("line hall-b",))
        assert loop.time() - began < READING_TIME
        (problem,) = first.result().problems
        assert problem.endswith("gateway.toml: cannot be read within 60 s; is its disk there?")


async def test_orders_in_a_burst_are_one_reload_and_the_last_file_counts(serving):
    async with serving(LISTEN + HALL_A) as service:
        orders = [service.reloader.order() for _ in range(10)]
        service.file.write_text(LISTEN + HALL_B)
        assert len(set(orders)) == 1
        assert await orders[0] == Outcome(added=("line hall-b",), removed=("line hall-a",))
        assert [type(event) for event in service.events].count(ConfigApplied) == 1


async def test_a_listener_that_changes_is_bound_before_the_old_one_goes(serving):
    async with serving(LISTEN + HALL_A) as service:
        (old,) = service.running.gateway.listeners
        outcome = await service.reload(LISTEN + "clients = 3\n" + HALL_A)
        (new,) = service.running.gateway.listeners
        assert outcome == Outcome(changed=("listen scada",))
        assert old.told == ["find", "bind", "listen", "start", "finish", "close"]
        assert new.told == ["find", "bind", "listen", "start"]


@pytest.mark.parametrize("changed", ["line", "mirror"])
async def test_what_waits_in_a_mirror_that_is_replaced_is_answered(serving, changed):
    mirror = '[[image]]\nunit = 241\nof = "silo"\nread = [{ holding = "0-1", every = "10 s" }]\nstale = "60 s"\n'
    async with serving(LISTEN + HALL_A + mirror) as service:
        await asyncio.sleep(2.0)
        client = service.client()
        client.ask(241, WRITE)
        client.ask(241, READ)
        await asyncio.sleep(0.001)
        if changed == "mirror":
            await service.reload(LISTEN + HALL_A + mirror.replace("60 s", "50 s"))
        else:
            await service.reload(LISTEN + HALL_A.replace("devices", "queue = 10\ndevices") + mirror)
        assert [await client.answer(), await client.answer()] == [WRITE, "83 0B"]


async def test_a_listener_that_cannot_come_is_closed_and_nothing_has_changed(serving, monkeypatch):
    come = []

    def listen(doors):
        come.append(doors)
        raise ListenError("another socket was quicker")

    async with serving(LISTEN + HALL_A) as service:
        (stays,) = service.running.gateway.listeners
        monkeypatch.setattr(Doors, "listen", listen)
        assert await service.reload(LISTEN + "clients = 3\n" + HALL_B) == Outcome(("another socket was quicker",))
        assert [doors.told for doors in come] == [["find", "bind", "close"]]
        assert service.running.gateway.listeners == (stays,)
        assert stays.told == ["find", "bind", "listen", "start"]
        assert await service.client().asks(41, READ) == "03 02 00 00"


# --- images that persist ---------------------------------------------------------------------------

INTERVAL, ALWAYS = IMAGE + 'persist = "interval"\n', IMAGE + 'persist = "always"\n'


@pytest.fixture
def files(monkeypatch):
    files = MemoryFiles()
    monkeypatch.setattr("gateway.images.drivers.store.open_saved", files.open)
    return files


@pytest.fixture
def keeping(serving, files):
    @asynccontextmanager
    async def serve_and_keep(image: str) -> AsyncIterator[Service]:
        async with serving(LISTEN + HALL_A) as service:
            await service.reload(LISTEN + image)
            yield service

    return serve_and_keep


async def test_a_write_that_was_answered_while_a_new_listener_takes_its_address_is_there_after_it(keeping, monkeypatch):
    async def find(doors):
        assert await client.asks(200, WRITE) == WRITE

    async with keeping(ALWAYS) as service:
        client = service.client()
        monkeypatch.setattr(Doors, "find", find)
        await service.reload(LISTEN + "clients = 3\n" + INTERVAL)
        assert await service.client().asks(200, READ) == "03 02 00 07"


async def test_what_images_keep_is_read_beside_the_loop(keeping, files, monkeypatch):
    """65536 registers take most of a second."""
    loop = asyncio.get_running_loop()
    run, jobs = loop.run_in_executor, []

    def run_in_executor(executor, job, *args):
        jobs.append(executor._purpose)
        try:
            return run(executor, job, *args)
        finally:
            jobs.pop()

    def open_saved(folder):
        opened_in.extend(jobs)
        return files.open(folder)

    opened_in: list[str] = []
    monkeypatch.setattr(loop, "run_in_executor", run_in_executor)
    monkeypatch.setattr("gateway.images.drivers.store.open_saved", open_saved)
    async with keeping(ALWAYS):
        assert opened_in == ["read state"]


async def test_a_write_that_the_disk_refuses_during_a_reload_is_undone_in_the_new_image(keeping, files, monkeypatch):
    async def find(doors):
        client.ask(200, WRITE)

    async with keeping(ALWAYS) as service:
        client = service.client()
        files.is_full = True
        monkeypatch.setattr(Doors, "find", find)
        await service.reload(LISTEN + "clients = 3\n" + INTERVAL)
        assert await client.answer() == "86 04"
        assert await service.client().asks(200, READ) == "03 02 00 00"


async def test_an_image_that_shrinks_and_grows_again_has_its_values(keeping):
    async with keeping(INTERVAL) as service:
        assert await service.client().asks(200, "06 00 08 00 63") == "06 00 08 00 63"
        await service.reload(LISTEN + INTERVAL.replace("10", "5"))
        assert await service.client().asks(200, "03 00 08 00 01") == "83 02"
        await service.reload(LISTEN + INTERVAL)
        assert await service.client().asks(200, "03 00 08 00 01") == "03 02 00 63"


async def test_an_image_that_goes_and_comes_again_at_once_has_its_values(keeping, files):
    async with keeping(INTERVAL) as service:
        assert await service.client().asks(200, WRITE) == WRITE
        assert await service.reload(LISTEN + HALL_A) == Outcome(added=("line hall-a",), removed=("image shift",))
        await service.reload(LISTEN + INTERVAL)
        assert files.batches == []
        assert await service.client().asks(200, READ) == "03 02 00 07"


async def test_an_acknowledged_write_is_not_overwritten_by_an_older_one(keeping, files):
    async with keeping(INTERVAL) as service:
        assert await service.client().asks(200, "06 00 00 00 01") == "06 00 00 00 01"
        await service.reload(LISTEN + ALWAYS)
        assert await service.client().asks(200, WRITE) == WRITE
        await asyncio.sleep(5.0)
        assert files.kept == {("shift", Area.HOLDING): {0: 7}}


async def test_what_needs_a_restart_is_said(serving):
    async with serving(LISTEN + HALL_A) as service:
        outcome = await service.reload(LISTEN + HALL_A + '[log]\nlevel = "debug"\n[control]\nsocket = "/tmp/x"\n')
        assert outcome == Outcome(restart=("log", "control"))
        assert await service.reload(LISTEN + HALL_A) == Outcome()


async def test_add_ons_are_adopted_but_for_the_page_which_needs_a_restart(serving, monkeypatch):
    async def connect(*_: object) -> None:
        """There is no NATS."""

    monkeypatch.setattr(Fleet, "connect", connect)
    async with serving(LISTEN + HALL_A) as service:
        add_ons = '[web]\nbind = "http://127.0.0.1:8502"\n[fleet]\nservers = ["nats://127.0.0.1"]\n'
        outcome = await service.reload('site = "a"\n' + LISTEN + HALL_A + add_ons)
        assert (outcome.added, outcome.changed, outcome.restart) == (("fleet",), (), ("web",))


async def test_warnings_of_a_file_that_is_accepted_are_handed_on(serving):
    async with serving(LISTEN + HALL_A) as service:
        outcome = await service.reload(LISTEN.replace("127.0.0.1", "0.0.0.0") + HALL_A)
        assert outcome.changed == ("listen scada",)
        assert "clients from other machines may only read" in outcome.warnings[0]
        (told,) = [event for event in service.events if isinstance(event, ConfigWarning)]
        assert "clients from other machines may only read" in told.problem
        assert "add [[access]]" in told.help


async def test_a_mirror_follows_its_device_to_the_new_line(serving):
    mirror = '[[image]]\nunit = 241\nof = "silo"\nread = [{ holding = "0-1", every = "500 ms" }]\n'
    async with serving(LISTEN + HALL_A + HALL_B + mirror) as service:
        (before,) = service.running.gateway.mirrors
        await service.reload(LISTEN + HALL_A + HALL_B.replace("500", "400") + mirror)
        assert service.running.gateway.mirrors == (before,)
        await service.reload(LISTEN + HALL_A.replace("devices", "queue = 10\ndevices") + HALL_B + mirror)
        (after,) = service.running.gateway.mirrors
        assert after is not before
        await asyncio.sleep(2.0)
        assert await service.client().asks(241, READ) == "03 02 00 00"


async def test_a_mirror_that_is_replaced_while_a_write_is_under_way_shows_it_once_it_is_acknowledged(serving):
    upstream = '[[upstream]]\nname = "plant"\nto = "tcp://10.0.0.1:502"\nunits = [{ as = 71, unit = 1 }]\n'
    mirror = '[[image]]\nunit = 241\nof = "plant/71"\nread = [{ holding = "0-0", every = "10 s" }]\nstale = "60 s"\n'
    async with serving(LISTEN + upstream + mirror) as service:
        loop, server, register = asyncio.get_running_loop(), service.bench.lines["tcp://10.0.0.1:502"], bytes(2)

        def read(asked: TcpFrame) -> None:
            server.deliver(mbap.encode(asked.transaction, asked.unit, b"\3\2" + register))

        def write(asked: TcpFrame) -> None:
            nonlocal register
            register = asked.pdu[3:]
            server.deliver(mbap.encode(asked.transaction, asked.unit, asked.pdu))

        def answer(data: bytes) -> None:
            for asked in mbap.MbapFramer().cut(data):
                loop.call_later(*((0.5, write) if asked.pdu[0] == 6 else (0.01, read)), asked)

        server.on_write = answer
        writer, reader = service.client(), service.client()
        assert await reader.asks(71, READ) == "03 02 00 00"
        writer.ask(241, WRITE)
        for stale in ("50 s", "40 s"):
            await service.reload(LISTEN + upstream + mirror.replace("60 s", stale))
            await asyncio.sleep(0.1)
            assert await reader.asks(241, READ) == "03 02 00 00"
        assert await writer.answer() == WRITE
        assert await reader.asks(241, READ) == "03 02 00 07"


def answered_late(service: Service, unit: int, first: float, later: float) -> None:
    """The line's device answers the first request after `first` seconds, others after `later`; values are addresses."""
    loop = asyncio.get_running_loop()
    line = service.bench.lines["hall-a"]
    delays = [first]

    def answer(data: bytes) -> None:
        delay = delays.pop() if delays else later
        loop.call_later(delay, line.deliver, encode(unit, b"\x03\x02" + data[2:4]))

    line.on_write = answer


async def test_a_late_answer_is_awaited_by_the_line_that_succeeds_on_the_port(serving):
    async with serving(LISTEN + HALL_A) as service:
        answered_late(service, 1, first=1.3, later=0.3)
        client = service.client()
        assert await client.asks(41, "03 00 07 00 01") == "83 0B"
        await service.reload(LISTEN + HALL_A.replace("hall-a", "hall-x", 1).replace("silo", "silo-new"))
        await asyncio.sleep(0.1)
        assert await client.asks(41, "03 00 09 00 01") == "83 0B"
        await asyncio.sleep(3.0)
        assert await client.asks(41, "03 00 09 00 01") == "03 02 00 09"


async def asks_9_while_7_is_overdue(service: Service, *reloads: str) -> list[str]:
    """Unit 41 answers register 7 late; asked for 9 behind these reloads, at once and later."""
    answered_late(service, 1, first=1.3, later=0.3)
    client = service.client()
    assert await client.asks(41, "03 00 07 00 01") == "83 0B"
    for config in reloads:
        await service.reload(config)
    await asyncio.sleep(0.1)
    at_once = await client.asks(41, "03 00 09 00 01")
    await asyncio.sleep(3.0)
    return [at_once, await client.asks(41, "03 00 09 00 01")]


async def test_a_late_answer_is_awaited_when_the_port_gets_another_name(serving, tmp_path):
    link = tmp_path / "by-id"
    link.symlink_to("/dev/hall-a")
    async with serving(LISTEN + HALL_A) as service:
        service.bench.lines[str(link)] = service.bench.lines["hall-a"]
        renamed = LISTEN + HALL_A.replace("/dev/hall-a", str(link)).replace("hall-a", "hall-x", 1)
        assert await asks_9_while_7_is_overdue(service, renamed) == ["83 0B", "03 02 00 09"]
        assert not [event for event in service.events if isinstance(event, LineLost)]


async def test_a_late_answer_is_awaited_when_a_device_server_is_written_otherwise(serving):
    server = 'port = "rtu+tcp://moxa:4001"\ntimeout = "1 s"\nlatency = "5 ms"\n'
    line = HALL_A.replace('port = "/dev/hall-a"\n', server)
    renamed = LISTEN + line.replace("rtu+tcp://moxa", "rtu+tcp://MOXA").replace('"hall-a"', '"hall-x"')
    async with serving(LISTEN + line) as service:
        behind = service.bench.lines["rtu+tcp://moxa:4001"]
        service.bench.lines |= {"rtu+tcp://MOXA:4001": behind, "hall-a": behind}
        assert await asks_9_while_7_is_overdue(service, renamed) == ["83 0B", "03 02 00 09"]


async def test_a_late_answer_is_awaited_by_a_line_that_went_and_comes_again(serving):
    async with serving(LISTEN + HALL_A) as service:
        reloads = LISTEN + HALL_B, LISTEN + HALL_A
        assert await asks_9_while_7_is_overdue(service, *reloads) == ["83 0B", "03 02 00 09"]


async def test_lines_that_exchange_their_ports_wait_for_one_another(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        service.bench.lines["hall-a"].on_write = service.bench.lines["hall-b"].on_write = lambda data: None
        client = service.client()
        client.ask(41, READ)
        client.ask(2, READ)
        await asyncio.sleep(0.01)
        exchanged = (HALL_A + HALL_B).replace("/dev/hall-a", "x").replace("/dev/hall-b", "/dev/hall-a")
        assert (await service.reload(LISTEN + exchanged.replace('"x"', '"/dev/hall-b"'))).problems == ()
        await asyncio.sleep(1.0)
        assert not [event for event in service.events if isinstance(event, LineLost)]
        assert {line.openings for line in service.bench.lines.values()} == {2}


async def test_upstreams_to_the_same_server_come_and_go_together(serving):
    upstream = '[[upstream]]\nname = "one"\nto = "tcp://10.0.0.1:502"\nunits = [{ as = 71, unit = 1 }]\n'
    both = upstream + upstream.replace("one", "two").replace("71", "72")
    async with serving(LISTEN + HALL_A) as service:
        assert await service.reload(LISTEN + HALL_A + both) == Outcome(added=("upstream one", "upstream two"))
        await asyncio.sleep(0.1)
        assert all(part.reconnector.tried.is_set() for part in service.running.gateway.parts)
        changed = both.replace("units", 'timeout = "2 s"\nunits'.replace("\\\n", "\n"))
        assert await service.reload(LISTEN + HALL_A + changed) == Outcome(changed=("upstream one", "upstream two"))
        await asyncio.sleep(0.1)
        assert all(part.reconnector.tried.is_set() for part in service.running.gateway.parts)
        assert await service.reload(LISTEN + HALL_A) == Outcome(removed=("upstream one", "upstream two"))
        assert not [event for event in service.events if isinstance(event, PartFailed)]


async def test_a_rejected_reload_leaves_the_units_of_a_line_that_passes_them_through(serving, monkeypatch):
    def listen(doors):
        raise ListenError("another socket was quicker")

    line = '[[line]]\nname = "hall-a"\nport = "/dev/hall-a"\n'
    async with serving(LISTEN + line) as service:
        before = dict(service.part("hall-a").devices)
        source = service.part("hall-a").plan.line.source
        monkeypatch.setattr(Doors, "listen", listen)
        outcome = await service.reload(LISTEN + IMAGE + '[[listen]]\nbind = "tcp://127.0.0.1:5021"\n' + line)
        assert outcome.problems == ("another socket was quicker",)
        assert service.part("hall-a").devices == before
        assert service.part("hall-a").plan.line.source == source


async def test_a_unit_that_an_image_gives_back_to_its_line_may_be_one_that_moves(serving):
    line = '[[line]]\nname = "hall-a"\nport = "/dev/hall-a"\nprofile = "weigher"\n'
    async with serving(LISTEN + line + IMAGE) as service:
        assert await service.reload(LISTEN + line) == Outcome(removed=("image shift",))
        assert service.part("hall-a").devices[200].unit == 200


async def test_a_line_that_passes_units_through_is_not_touched_by_an_image_that_takes_one(serving):
    line = '[[line]]\nname = "hall-a"\nport = "/dev/hall-a"\n'
    async with serving(LISTEN + line) as service:
        before = service.part("hall-a")
        client = service.client()
        assert await service.reload(LISTEN + line + IMAGE) == Outcome(added=("image shift",))
        assert service.part("hall-a") is before
        assert await client.asks(200, READ) == "03 02 00 00"
        assert 200 not in before.devices
        await service.reload(LISTEN + line)
        assert service.part("hall-a") is before
        assert 200 in before.devices
        assert (await client.asks(200, READ))[:2] == "83"
        await service.reload(LISTEN + line + 'timeout = "300 ms"\n')
        assert service.part("hall-a") is not before


async def test_a_line_that_has_to_finish_holds_up_no_other(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        service.bench.lines["hall-b"].on_write = lambda data: None
        client = service.client()
        client.ask(2, READ)
        await asyncio.sleep(0.01)
        reload = asyncio.ensure_future(
            service.reload(LISTEN + HALL_A.replace("devices", "queue = 10\ndevices") + HALL_B.replace("500", "400"))
        )
        await asyncio.sleep(0.1)
        assert await client.asks(41, READ) == "03 02 00 00"
        assert not reload.done()
        assert await client.answer() == "83 0B"
        await reload


async def test_an_order_to_stop_ends_a_reload_and_what_is_under_way_is_answered(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        answered_late(service, 1, first=0.3, later=0.3)
        client = service.client()
        client.ask(41, READ)
        await asyncio.sleep(0.05)
        reload = service.reloader.order()
        service.file.write_text(LISTEN + HALL_B)
        await asyncio.sleep(0.05)
        service.running.gateway.listeners[0].has_clients = True
        service.stop.order("SIGTERM")
        assert await client.answer() == "03 02 00 00"
        await asyncio.sleep(5.0)
        assert reload.cancelled()
        assert not service.bench.lines["hall-a"].is_open


async def test_a_defect_in_a_reload_is_told_and_the_old_config_serves_on(serving, monkeypatch):
    async with serving(LISTEN + HALL_A) as service:
        monkeypatch.setattr(build.Builder, "build", lambda *_: 1 / 0)
        outcome = await service.reload(LISTEN + HALL_A + HALL_B)
        assert outcome.problems == ("a defect in the gateway: ZeroDivisionError('division by zero')",)
        assert [type(event) for event in service.events].count(PartFailed) == 1
        assert await service.client().asks(41, READ) == "03 02 00 00"


@pytest.mark.interpreted
async def test_a_defect_behind_the_switch_is_told_as_one_and_the_new_config_is_in_force(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        service.part("hall-b").driver.finish = lambda: 1 / 0
        outcome = await service.reload(LISTEN + HALL_A)
        assert (outcome.problems, outcome.removed) == ((), ("line hall-b",))
        assert outcome.defect.startswith("a defect in the gateway: ")
        assert [type(event) for event in service.events].count(PartFailed) == 1
        assert [part.name for part in service.running.gateway.parts] == ["hall-a"]


@pytest.mark.interpreted
async def test_a_line_that_a_defect_has_kept_from_starting_can_be_taken_out(serving):
    async with serving(LISTEN + HALL_A + HALL_B) as service:
        service.part("hall-a").driver.finish = lambda: 1 / 0
        client = service.client()
        service.bench.lines["hall-b"].on_write = lambda data: None
        client.ask(2, READ)
        await asyncio.sleep(0.1)
        assert (await service.reload(LISTEN + HALL_B.replace("500", "400"))).defect
        outcome = await service.reload(LISTEN + HALL_A)
        assert (outcome.defect, outcome.removed) == ("", ("line hall-b",))


async def test_a_line_that_goes_repeats_nothing(serving):
    async with serving(LISTEN + HALL_A + HALL_B.replace("devices", "retries = 1\ndevices")) as service:
        line, loop = service.bench.lines["hall-b"], asyncio.get_running_loop()
        asked = []

        def break_off(data: bytes) -> None:
            asked.append(data)
            loop.call_later(0.05, line.deliver, bytes.fromhex("02 03 02 00 00 FF"))

        line.on_write = break_off
        client = service.client()
        client.ask(2, READ)
        await asyncio.sleep(0.1)
        await service.reload(LISTEN + HALL_A)
        assert await client.answer() == "83 0B"
        assert len(asked) == 1


async def test_a_reload_is_not_refused_for_what_a_start_only_warns_of(serving, tmp_path):
    web = f"""
[web]
bind = "https://127.0.0.1:8443"
certificate = "{tmp_path}/web.crt"
key = "{tmp_path}/web.key"
"""
    async with serving(LISTEN + HALL_A) as service:
        outcome = await service.reload(LISTEN + HALL_A + HALL_B + web)
        assert outcome.problems == ()
        assert "line hall-b" in outcome.added
        assert any("web.crt" in each for each in outcome.warnings)
        assert any("web.crt" in str(each) for each in service.events if isinstance(each, ConfigWarning))


async def test_a_rejected_reload_leaves_nothing_of_the_unit_made_in_python_that_it_would_have_brought(
    serving, monkeypatch, tmp_path
):
    def listen(doors):
        raise ListenError("another socket was quicker")

    module = "from gateway import CustomUnit\n\nclass Unit(CustomUnit):\n    async def read(self, *words): ...\n"
    (tmp_path / "unit_of_reload.py").write_text(module)
    monkeypatch.syspath_prepend(tmp_path)
    made = '[[image]]\nunit = 60\npython = "unit_of_reload:Unit"\n'
    async with serving(LISTEN + HALL_A) as service:
        with monkeypatch.context() as patch:
            patch.setattr(Doors, "listen", listen)
            assert (await service.reload(LISTEN + "clients = 3\n" + HALL_A + made)).problems
        assert service.running.builder.custom._drivers == []
        assert (await service.reload(LISTEN + HALL_A + made)).added == ("image image-60",)
        assert len(service.running.builder.custom._drivers) == 1
