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


def go(config, act, name):
    bad = 0
    n = 1
    import time
    t=time.time()
    while True:
        found = run(live(config), act(n))
        if found.left:
            bad += 1
            if bad<6: print(name, n, found)
        if found.outcome == "through":
            break
        if not isinstance(found.outcome, asyncio.CancelledError):
            print(name, n, repr(found.outcome))
        n += 1
    print(name, n, bad, time.time()-t)

def test_each(config):
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
    go(config, once, "once")
    for k in (1,2,3,5): go(config, more(k), f"more{k}")
    go(config, all_, "all")
