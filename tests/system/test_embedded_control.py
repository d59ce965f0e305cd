"""A gateway inside a program that commands and pages reach, and what a reload does there."""

import asyncio
import json
import logging
import os
import signal
import sys

import aiohttp
import pytest

from gateway import CustomUnit, Gateway
from gateway.events import ConfigWarning
from kit.free_port import free_port

CONFIG = """\
[[listen]]
bind = "tcp://127.0.0.1:0"

[[image]]
unit = 5
name = "table"
holding = 10

[control]
socket = "run/control.sock"
"""
MORE = CONFIG + '[[image]]\nunit = 6\nname = "more"\nholding = 10\n'
NO_RELOAD = "the config is a {} of the program that runs this gateway, and cannot be read again"


class Clock(CustomUnit):
    """Any unit."""

    async def read(self, area, address, count):
        return [7] * count


async def command(folder, *words, status=0):
    """Run a command against the gateway of the control socket in `folder`; return what it printed."""
    words = [*words, "--control", str(folder / "run" / "control.sock")]
    pipes = {"stdout": asyncio.subprocess.PIPE, "stderr": asyncio.subprocess.STDOUT}
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", "gateway", *words, **pipes)
    said, _ = await process.communicate()
    assert process.returncode == status, said.decode()
    return said.decode()


async def test_commands_reach_a_gateway_whose_config_names_a_control_socket(tmp_path):
    async with Gateway.from_text(CONFIG, folder=tmp_path) as gateway:
        assert "table" in await command(tmp_path, "status")
        seen = json.loads(await command(tmp_path, "status", "--json"))
        assert [each["address"] for each in seen["listeners"]] == gateway.addresses
    assert not (tmp_path / "run" / "control.sock").exists()


async def test_there_is_no_control_socket_unless_the_config_names_one(tmp_path, monkeypatch):
    for variable in ("HOME", "XDG_RUNTIME_DIR", "RUNTIME_DIRECTORY"):
        monkeypatch.setenv(variable, str(tmp_path))
    monkeypatch.chdir(tmp_path)
    async with Gateway.from_text(CONFIG[: CONFIG.index("[control]")]):
        assert list(tmp_path.rglob("*")) == []


async def test_a_file_is_read_again(tmp_path, caplog):
    file = tmp_path / "plant.toml"
    file.write_text(CONFIG)
    async with await asyncio.to_thread(Gateway.from_toml, file, units={60: Clock()}) as gateway:
        assert await gateway.unit("clock-60").read_holding(0) == [7]
        listeners = gateway.addresses
        assert await command(tmp_path, "reload")
        file.write_text(MORE)
        assert "new: image more" in await command(tmp_path, "reload")
        assert await gateway.unit("more").read_holding(0) == [0]
        assert gateway.addresses == listeners
        file.write_text(CONFIG.replace("unit = 5", "unit = 60"))
        said = await command(tmp_path, "reload", status=1)
        assert f'{file}: error: units[60]: 60 is already a unit of image "table" (plant.toml:4)' in said
        file.write_text(CONFIG.replace("holding = 10", 'holding = 10\npersist = "always"'))
        assert "image[0].persist: needs a folder" in await command(tmp_path, "reload", status=1)
        assert await gateway.unit("more").read_holding(0) == [0]


async def test_a_program_may_go_to_another_folder_before_the_start(tmp_path, monkeypatch):
    (tmp_path / "plant.toml").write_text(CONFIG)
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path)
    made = Gateway.from_toml("plant.toml", state="state")
    monkeypatch.chdir("elsewhere")
    async with made:
        (tmp_path / "plant.toml").write_text(MORE)
        assert "new: image more" in await command(tmp_path, "reload")
    assert (tmp_path / "state" / "configs").is_dir()
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.parametrize("kind", ["text", "dict"])
async def test_a_config_of_the_program_is_not_read_again(kind, tmp_path):
    port, table = free_port(), {"listen": [{"bind": "tcp://127.0.0.1:0"}], "image": [{"unit": 5, "holding": 10}]}
    table |= {"control": {"socket": "run/control.sock"}, "web": {"bind": f"http://127.0.0.1:{port}"}}
    text = f'{CONFIG}[web]\nbind = "http://127.0.0.1:{port}"\n'
    made = Gateway(table, folder=tmp_path) if kind == "dict" else Gateway.from_text(text, folder=tmp_path)
    async with made as gateway, aiohttp.ClientSession(f"http://127.0.0.1:{port}") as session:
        assert NO_RELOAD.format(kind) in await command(tmp_path, "reload", status=1)
        async with session.get("/api/v1/config") as answer:
            told = await answer.json()
            assert (answer.status, told["file"]) == (200, f"<{kind}>")
        async with session.get("/config") as answer:
            page = await answer.text()
            assert (answer.status, NO_RELOAD.format(kind) in page) == (200, True)
            assert "/config/reload" not in page
        assert await gateway.unit(5).read_holding(0) == [0]
        assert gateway._operator.running.reload_succeeded


async def test_sighup_is_left_to_the_program(tmp_path):
    hung_up = asyncio.Event()
    asyncio.get_running_loop().add_signal_handler(signal.SIGHUP, hung_up.set)
    before = [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)]
    async with Gateway.from_text(CONFIG, folder=tmp_path) as gateway:
        assert [signal.getsignal(each) for each in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)] == before
        os.kill(os.getpid(), signal.SIGHUP)
        await hung_up.wait()
        assert gateway._operator.reloader.last is None


async def test_warnings_about_a_config_that_is_used_are_events_and_log_records(tmp_path, caplog):
    caplog.set_level(logging.INFO, "gateway")
    line = '[[line]]\nport = "/dev/absent"\nbaud = 9600\nformat = "8E1"\n'
    text = f'{CONFIG}[log]\nlevel = "debug"\nformat = "json"\n{line}'
    async with Gateway.from_text(text, folder=tmp_path):
        pass
    warnings = [each.event for each in caplog.records if isinstance(getattr(each, "event", None), ConfigWarning)]
    (about_port,) = (each for each in warnings if each.problem.startswith("<text>:15:8: warning: line[0].port: "))
    assert about_port.help == "the line waits for it; modbus-gateway ports lists those that exist"
    assert logging.getLogger("gateway").level == logging.INFO
