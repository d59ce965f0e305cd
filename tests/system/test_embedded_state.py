"""What an embedded gateway keeps in a folder, as the daemon does; and that it writes nothing without one."""

import asyncio
import logging
import threading
from contextlib import asynccontextmanager

import pytest

from gateway import ConfigError, Gateway, StateError
from gateway.errors import NoResponse
from gateway.library import state
from gateway.runtime.overdue import LeftBehind
from gateway.state.entry_file import EntryFile
from gateway.state.memory import StateFile
from kit.free_port import free_port

LISTEN = 'site = "plant"\n[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
IMAGE = f'{LISTEN}[[image]]\nunit = 5\nholding = 10\npersist = "always"\n'
MQTT = '[mqtt]\nbroker = "mqtt://127.0.0.1:{port}"\npublish = [{{ device = "silo", every = "1 s" }}]\n'
KEEP = 'keep = "1 MiB"\n'
WRITE_42 = bytes.fromhex("060000002a")


@asynccontextmanager
async def silent_server():
    """A device server that never answers; yields its address."""

    async def served(reader, writer):
        await reader.read()
        writer.close()

    async with await asyncio.start_server(served, "127.0.0.1", 0) as server:
        host, port = server.sockets[0].getsockname()
        yield f"rtu+tcp://{host}:{port}"


def line(port):
    return f"""\
[[line]]
port = "{port}"
baud = 9600
format = "8E1"
late_window = "5 min"
devices = [{{ unit = 1, name = "silo", profile = "xy-md02" }}]
"""


def test_what_must_be_kept_needs_a_folder():
    virtual = """\
[[image]]
unit = 6
map = [{ at = 0, device = "image-5", holding = 3, every = "1 s" }]
holding = "10-19"
persist = "interval"
"""
    with pytest.raises(ConfigError) as caught:
        Gateway.from_text(IMAGE + virtual + MQTT.format(port=1883) + KEEP + line("/dev/null"))
    what, remedy = (
        "needs a folder, and the gateway was given none",
        'name one where the gateway is made: state="FOLDER"',
    )
    errors = [each for each in caught.value.problems if each.severity == "error"]
    assert [(each.path, each.line, each.what, each.remedy) for each in errors] == [
        (("image", 0, "persist"), 7, what, remedy),
        (("image", 1, "persist"), 12, what, remedy),
        (("mqtt", "keep"), 16, what, remedy),
    ]


async def test_images_outlive_the_gateway(tmp_path):
    for expected in (0, 42):
        async with Gateway.from_text(IMAGE, state=str(tmp_path)) as gateway:
            assert await gateway.unit(5).read_holding(0) == [expected]
            await gateway.unit(5).request(WRITE_42)


async def test_values_that_are_kept_soon_are_on_the_disk_at_the_end_and_no_timer_is_left(tmp_path):
    text = IMAGE.replace("always", "interval")
    async with Gateway.from_text(text, state=tmp_path) as gateway:
        await gateway.unit(5).request(WRITE_42)
    loop = asyncio.get_running_loop()
    assert [each for each in loop._scheduled if not each.cancelled()] == []
    async with Gateway.from_text(text, state=tmp_path) as gateway:
        assert await gateway.unit(5).read_holding(0) == [42]


async def test_a_reload_may_bring_what_must_be_kept(tmp_path):
    file = tmp_path / "plant.toml"
    file.write_text(IMAGE.replace('persist = "always"', ""))
    async with Gateway.from_toml(file, state=tmp_path / "state") as gateway:
        file.write_text(IMAGE)
        outcome = await gateway._operator.reloader.order()
        assert (outcome.problems, outcome.changed) == ((), ("image image-5",))
        await gateway.unit(5).request(WRITE_42)
    async with Gateway.from_toml(file, state=tmp_path / "state") as gateway:
        assert await gateway.unit(5).read_holding(0) == [42]


async def test_virtual_ports_are_linked_in_the_folder_of_the_config(tmp_path):
    server = '[[line]]\nrole = "server"\nport = "pty:hall"\nserves = [5]\n'
    async with Gateway.from_text(IMAGE.replace('persist = "always"', "") + server, folder=tmp_path):
        assert (tmp_path / "hall").is_symlink()
    assert list(tmp_path.iterdir()) == []


async def test_a_late_answer_is_known_to_the_next_gateway(tmp_path):
    async with silent_server() as server:
        text = LISTEN + line(server)
        async with Gateway.from_text(text, state=tmp_path) as gateway:
            with pytest.raises(NoResponse):
                await gateway.unit("silo").read_holding(0)
        left = LeftBehind(EntryFile(tmp_path / "late.json", lambda _: True, lambda _: None))
        place = server.partition("//")[2]
        assert len(left.at(place, asyncio.get_running_loop().time())) == 1


async def test_a_device_that_has_moved_is_remembered(tmp_path, caplog):
    caplog.set_level(logging.INFO, "gateway")
    gateway = Gateway.from_text(LISTEN + line("rtu+tcp://127.0.0.1:1"), state=tmp_path)
    port = gateway._config.plan.lines[0].port.port
    memory = StateFile(tmp_path, lambda _: None)
    memory.remember(f"{port} silo", 1, 7)
    memory.close()
    async with gateway:
        pass
    assert any("silo" in each and "it moved in an earlier run; set unit = 7" in each for each in caplog.messages)


async def test_events_and_trends_are_kept(tmp_path):
    port = free_port()
    web = f'[web]\nbind = "http://127.0.0.1:{port}"\nvalues = "1 h"\n'
    for runs in (1, 2):
        async with Gateway.from_text(IMAGE + web, state=tmp_path) as gateway:
            await asyncio.sleep(0.3)
            names = [each.name for each in gateway._operator.events.all()]
            assert names.count("ready") == runs
    assert {"events.sqlite", "history.sqlite", "trends.sqlite"} <= {each.name for each in tmp_path.iterdir()}


async def test_values_for_a_broker_are_kept(tmp_path):
    text = LISTEN + line("rtu+tcp://127.0.0.1:1") + MQTT.format(port=free_port()) + KEEP
    async with Gateway.from_text(text, state=tmp_path):
        for _ in range(100):
            if (tmp_path / "mqtt-kept.sqlite").exists():
                break
            await asyncio.sleep(0.05)
    assert (tmp_path / "mqtt-kept.sqlite").exists()


async def test_the_last_configs_are_kept_of_a_file_only(tmp_path):
    state, file = tmp_path / "state", tmp_path / "plant.toml"
    file.write_text(IMAGE)
    async with Gateway.from_text(IMAGE, state=state):
        await asyncio.sleep(0.1)
    assert not (state / "configs").exists()
    async with Gateway.from_toml(file, state=state):
        for _ in range(100):
            if list(state.glob("configs/*/plant.toml")):
                break
            await asyncio.sleep(0.05)
    (kept,) = state.glob("configs/*/plant.toml")
    assert kept.read_text() == IMAGE


async def test_two_gateways_cannot_have_one_folder_at_a_time(tmp_path):
    text = LISTEN + "[self]\nunit = 5\n[[image]]\nunit = 6\nholding = 1\n"
    async with Gateway.from_text(text, state=tmp_path) as first:
        with pytest.raises(StateError, match=f"{tmp_path} is in use by another gateway: give each a folder of its own"):
            async with Gateway.from_text(text, state=tmp_path):
                pytest.fail("it has started")
        assert await first.unit(6).read_holding(0) == [0]
        async with Gateway.from_text(text, state=tmp_path / "other"):
            pass
    async with Gateway.from_text(text, state=tmp_path):
        pass


async def test_images_that_a_daemon_has_open_are_a_state_error(tmp_path):
    async with Gateway.from_text(IMAGE, state=tmp_path):
        (tmp_path / "embedded.lock").unlink()  # a daemon does not take it
        with pytest.raises(StateError, match=r"images\.log is in use; is another modbus-gateway running"):
            async with Gateway.from_text(IMAGE, state=tmp_path):
                pytest.fail("it has started")


async def test_a_folder_that_cannot_be_written_is_told_and_the_gateway_serves(tmp_path, caplog):
    (tmp_path / "file").write_text("")
    async with Gateway.from_text(
        f"{LISTEN}[[image]]\nunit = 5\nholding = 10\n", state=tmp_path / "file" / "state"
    ) as gateway:
        assert await gateway.unit(5).read_holding(0) == [0]
    assert any(f"{tmp_path}/file is no folder" in each for each in caplog.messages)


async def test_without_a_folder_nothing_is_written(tmp_path, monkeypatch):
    for variable in ("HOME", "XDG_STATE_HOME", "STATE_DIRECTORY", "XDG_RUNTIME_DIR", "TMPDIR"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    web = f'[web]\nbind = "http://127.0.0.1:{free_port()}"\nvalues = "1 h"\n'
    mqtt = MQTT.format(port=free_port()) + "home_assistant = true\n"
    async with silent_server() as server, Gateway.from_text(LISTEN + line(server) + web + mqtt) as gateway:
        with pytest.raises(NoResponse):
            await gateway.unit("silo").read_holding(0)
        await asyncio.sleep(0.2)
    assert list(tmp_path.rglob("*")) == []


@pytest.mark.parametrize("steps", [*range(40)])
async def test_a_start_that_is_cancelled_lets_the_folder_go(tmp_path, steps):
    async def run():
        async with Gateway.from_text(IMAGE, state=tmp_path):
            await asyncio.sleep(1)

    task = asyncio.create_task(run())
    for _ in range(steps):
        await asyncio.sleep(0.0005)
    task.cancel()
    with pytest.raises(asyncio.CancelledError):
        await task
    await until(lambda: threading.active_count() == 1)
    async with Gateway.from_text(IMAGE, state=tmp_path) as gateway:
        assert await gateway.unit(5).read_holding(0) == [0]


class SlowLock:
    """The lock of a folder on a disk that takes its time, until `goes_on`: at the begin, or at the end."""

    def __init__(self, monkeypatch, at):
        self.goes_on, self.is_reached, self.is_held = threading.Event(), threading.Event(), False
        self._at = at
        monkeypatch.setattr(state, "_alone_in", lambda _folder: self)

    def __enter__(self):
        self._wait("begin")
        self.is_held = True

    def __exit__(self, *_):
        self._wait("end")
        self.is_held = False

    def _wait(self, at):
        if at == self._at:
            self.is_reached.set()
            assert self.goes_on.wait(10)


async def live(tmp_path):
    async with Gateway.from_text(IMAGE, state=tmp_path):
        pass


async def until(is_so):
    for _ in range(1000):
        if is_so():
            return
        await asyncio.sleep(0.01)
    pytest.fail("it never came to that")


@pytest.mark.parametrize("patience", [0.02, 5.0])
async def test_a_start_that_is_cancelled_waits_little_for_a_slow_disk_and_all_is_closed_again(
    patience, tmp_path, monkeypatch
):
    lock = SlowLock(monkeypatch, "begin")
    monkeypatch.setattr(state, "_PATIENCE", patience)
    living = asyncio.create_task(live(tmp_path))
    await until(lock.is_reached.is_set)
    asyncio.get_running_loop().call_later(0.2, lock.goes_on.set)
    living.cancel()
    await asyncio.wait([living])
    assert living.cancelled()
    assert lock.goes_on.is_set() == (patience > 1)
    lock.goes_on.set()
    await until(lambda: threading.active_count() == 1)
    assert not lock.is_held


async def test_a_stop_that_is_cancelled_still_writes_what_is_kept(tmp_path, monkeypatch):
    lock = SlowLock(monkeypatch, "end")
    living = asyncio.create_task(live(tmp_path))
    await until(lock.is_reached.is_set)
    for _ in range(3):
        for each in asyncio.all_tasks() - {asyncio.current_task()}:
            each.cancel()
        await asyncio.sleep(0.01)
    assert not living.done()
    lock.goes_on.set()
    await asyncio.wait([living])
    assert living.cancelled()
    assert not lock.is_held
