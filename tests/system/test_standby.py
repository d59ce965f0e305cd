"""Two gateways with one lease on one bus: a short form of tests/soak/standby.py, each kind of fault once."""

import json
import os
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from kit.nats import NatsServer
from kit.process import PATIENCE
from kit.shared_bus import Bus, sometimes_late
from soak.standby import OLDER_STORE, TTL, Site, Stage

#: A lease that lasts long, in seconds.
LONG_TTL = 6.0
#: How long a client waits before it asks again, in seconds: a hundredth of the shortest lease.
PAUSE = 0.02


@contextmanager
def stage_in(folder: Path, ttl: float) -> Iterator[Stage]:
    """Two gateways on one bus, one of which asks; a lease lasts so many seconds."""
    bus = Bus(lateness=sometimes_late(seed=1, share=0.02, longest=0.3))
    with ExitStack() as stack:
        nats = stack.enter_context(NatsServer(folder))
        sites = []
        for name in ("a", "b"):
            bus.terminal(name, folder / f"tty-{name}")
            sites.append(Site(name, folder, nats, bus, str(folder / f"tty-{name}"), ttl, None, PAUSE))
        stack.enter_context(bus)
        for site in sites:
            stack.enter_context(site.running())
        yield Stage(1, nats, bus, (sites[0], sites[1]), has_clock=False)


@pytest.fixture(scope="module")
def stage(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    """Each test leaves it as it was."""
    with stage_in(tmp_path_factory.mktemp("standby"), TTL) as found:
        yield found


@pytest.mark.needs("nats-server")
@pytest.mark.parametrize(
    "fault",
    [
        "the holder is killed",
        "the holder is stopped",
        "NATS is away",
        "the holder's link is held",
    ],
)
def test_two_never_ask_at_once_and_one_goes_on(stage: Stage, fault: str) -> None:
    stage.suffer(fault, 1.2 * TTL)
    assert not [each for each in stage.bus.collisions if not stage.was_just_continued(each)]
    assert sum(site.answers["wrong"] for site in stage.sites) == 0


@pytest.mark.needs("nats-server")
@pytest.mark.parametrize("released", [True, pytest.param(False, marks=pytest.mark.search)])
def test_two_never_ask_at_once_when_the_store_comes_back_older(tmp_path: Path, released: bool) -> None:
    """The holder cannot reach it; the standby finds a released lease, or an old one of its own, and waits all the same.

    The lease is long, so that who would not wait is met by the holder, or heard.
    """
    with stage_in(tmp_path, LONG_TTL) as stage:
        stage.keep_store(released=released)
        before = [len(site.losses) for site in stage.sites]
        stage.suffer(OLDER_STORE, LONG_TTL)
        assert not [each for each in stage.bus.collisions if not stage.was_just_continued(each)]
        losses = [why for site, known in zip(stage.sites, before, strict=True) for why in site.losses[known:]]
        assert not [why for why in losses if "another client" in why]
        assert sum(site.answers["wrong"] for site in stage.sites) == 0


def hand_over(stage: Stage) -> float:
    """Stop the holder, and wait until the other one asks: how long that one had to be silent first, in seconds."""
    stage.wait_for_service()
    holder, standby = stage.holder, stage.standby
    before = len(standby.silences)
    assert holder.end() == 0
    deadline = time.monotonic() + PATIENCE
    while stage.holder is not standby or len(standby.silences) == before:
        assert time.monotonic() < deadline, "nobody goes on"
        time.sleep(0.01)
    holder.start()
    return standby.silences[-1]


@pytest.mark.needs("nats-server")
def test_after_a_stop_the_other_one_goes_on_at_once(stage: Stage) -> None:
    """Only after a release it need not be silent. A busy machine may be too slow for the release, but not each time."""
    assert any(hand_over(stage) == 0 for _ in range(5))
    assert not [each for each in stage.bus.collisions if not stage.was_just_continued(each)]


@pytest.mark.parametrize(("lease", "holds"), [("plant-1.hall-a", True), ("plant-1.hall-b", False), ("other", False)])
def test_keepalived_is_told_whether_the_gateway_holds_the_lease(tmp_path: Path, lease: str, holds: bool) -> None:
    leases = [{"name": "plant-1.hall-a", "is_held": True}, {"name": "plant-1.hall-b", "is_held": False}]
    gateway = tmp_path / "modbus-gateway"
    asked = "status --json --control /run/modbus-gateway/control.sock"
    gateway.write_text(f"#!/bin/sh\n[ \"$*\" = '{asked}' ] && echo '{json.dumps({'leases': leases})}'\n")
    gateway.chmod(0o755)
    script = Path(__file__).parents[2] / "deploy" / "keepalived" / "holds-lease"
    path = f"{tmp_path}:{os.environ['PATH']}"
    told = subprocess.run([script, lease], env={**os.environ, "PATH": path}, check=False)
    assert (told.returncode == 0) is holds


def test_without_a_running_gateway_it_holds_no_lease(tmp_path: Path) -> None:
    gateway = tmp_path / "modbus-gateway"
    gateway.write_text("#!/bin/sh\nexit 1\n")
    gateway.chmod(0o755)
    script = Path(__file__).parents[2] / "deploy" / "keepalived" / "holds-lease"
    env = {**os.environ, "PATH": f"{tmp_path}:{os.environ['PATH']}"}
    assert subprocess.run([script, "hall-a"], env=env, capture_output=True, check=False).returncode != 0
