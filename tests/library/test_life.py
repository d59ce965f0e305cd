"""The life of an embedded gateway: whatever is cancelled at whatever step, nothing stays behind. In virtual time."""

import asyncio
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from gateway import Gateway, NoResponse
from kit.pty import VirtualPort
from kit.stepping_loop import Main, Run, run

CONFIG = """
[[line]]
name = "hall"
port = "{port}"
devices = [{{ unit = 1 }}]

[[line]]
name = "absent"
port = "/dev/absent"
devices = [{{ unit = 2 }}]

[[image]]
unit = 9
holding = "0-9"

[[listen]]
bind = "tcp://127.0.0.1:0"

[[listen]]
bind = "udp://127.0.0.1:0"
"""


@pytest.fixture
def config(tmp_path: Path) -> Iterator[str]:
    """A config with a line whose device never answers."""
    with VirtualPort(tmp_path / "port") as port:
        yield CONFIG.format(port=port.path)


async def live(config: str) -> str:
    """Start a gateway, ask it, and stop it."""
    async with Gateway.from_text(config) as gateway:
        assert len(gateway.addresses) == 2
        asking = [asyncio.create_task(gateway.unit(1).read_holding(0)) for _ in range(3)]
        assert await gateway.unit(9).read_holding(0, 2) == [0, 0]
        for each in asking:
            with pytest.raises(NoResponse):
                await each
    return "through"


def test_it(config):
    found = run(live(config))
    print(found)
    assert found.left == []


EVERYTHING = """
site = "plant"

[[line]]
name = "hall"
port = "{port}"
devices = [{{ unit = 1, name = "silo-1", profile = "weigher" }}]

[[line]]
name = "programs"
port = "pty:{folder}/link"
role = "server"
serves = "all"

[[line]]
name = "device-server"
port = "rtu+tcp://127.0.0.1:1"
role = "monitor"

[[upstream]]
name = "far"
to = "tcp://127.0.0.1:1"
units = [{{ unit = 2 }}]

[[image]]
unit = 9
holding = "0-9"

[[image]]
unit = 20
of = "silo-1"
read = [{{ holding = "0-9", every = "1 s" }}]

[[image]]
unit = 240
name = "all"
map = [{{ at = 0, device = "silo-1", holding = "0-3", every = "1 s" }}]

[[listen]]
bind = "tcp://127.0.0.1:0"

[[listen]]
bind = "udp://127.0.0.1:0"

[[listen]]
bind = "rtu+tcp://127.0.0.1:0"
name = "rtu"

[web]
bind = "http://127.0.0.1:0"

[mqtt]
broker = "mqtt://127.0.0.1:1"
publish = [{{ device = "silo-1", every = "1 s" }}]

[fleet]
servers = ["nats://127.0.0.1:1"]
"""


async def live_all(config):
    async with Gateway.from_text(config) as gateway:
        asking = [asyncio.create_task(gateway.unit(u).read_holding(0)) for u in (1,2,20,9,240)]
        await asyncio.gather(*asking, return_exceptions=True)
    return "through"

def go(live, act, name):
    bad = 0
    n = 1
    import time
    t=time.time()
    while True:
        found = run(live(), act(n))
        if found.left:
            bad += 1
            if bad<6: print(name, n, found)
        if found.outcome == "through":
            break
        if not isinstance(found.outcome, asyncio.CancelledError):
            print(name, n, repr(found.outcome)); break
        n += 1
    print(name, n, bad, time.time()-t)

def test_each(tmp_path):
    def once(n):
        return lambda step, task: step == n and task.cancel()
    def more(k):
        return lambda n: (lambda step, task: step in (n,n+k,n+2*k) and task.cancel())
    def all_(n):
        def act(step, task):
            if step == n:
                for each in asyncio.all_tasks(task.get_loop()):
                    if each.get_name() != "waiting": each.cancel()
        return act
    from functools import partial
    from kit.pki import listener
    with VirtualPort(tmp_path / "port") as port:
        config = EVERYTHING.format(port=port.path, folder=tmp_path) + listener()
        for live_ in (partial(live_all, config),):
            go(live_, once, "once")
            for k in (1,2,3,5): go(live_, more(k), f"more{k}")
            go(live_, all_, "all")
