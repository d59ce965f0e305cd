"""Clients whose packets vanish, as when a cable is pulled: the gateway notices within a minute, and has room again.

    .venv/bin/python tests/soak/vanish.py

One client has nothing under way, the other one never gets its response. This runs in a network namespace of its own,
where their packets are dropped; it takes `nft` (Debian package nftables), and root or the right to make user
namespaces. Ends with status 0 if both connections were closed in time, 1 if not, 2 if this machine cannot show it.
"""

import os
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from math import inf
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from bad_clients import connect, read, receive

from kit.process import GatewayProcess

#: What is promised, in seconds.
CLOSED_WITHIN = 60.0
#: Nobody is closed for being idle, and there is room for two.
CONFIG = """
[[listen]]
bind = "tcp://127.0.0.1:0"
clients = 2
idle = "0"

[[image]]
unit = 1
holding = 1
"""
RESPONSE_SIZE = 11
#: What the second start of this script, in the namespace, is told.
INSIDE = "--inside"


def in_a_namespace() -> int:
    """Start this script again where dropping packets harms nobody."""
    user = [] if os.geteuid() == 0 else ["--user", "--map-root-user"]
    namespace = ["unshare", "--net", *user]
    try:
        tried = subprocess.run([*namespace, "nft", "list", "ruleset"], capture_output=True, text=True, check=False)
        trouble = tried.stderr.strip()
    except FileNotFoundError as error:
        trouble = str(error)
    if trouble:
        print(f"left out, for this machine cannot drop packets: {trouble}")
        return 2
    return subprocess.run([*namespace, sys.executable, __file__, INSIDE], check=False).returncode


def drop(end: str, client: socket.socket) -> None:
    """Drop what this client sends (`end` is sport), or what is sent to it (dport)."""
    port = client.getsockname()[1]
    chain = "type filter hook input priority 0"
    rules = f"table ip lost {{ chain {end}{port} {{ {chain}; tcp {end} {port} drop; }}; }}"
    subprocess.run(["nft", rules], check=True)


def ask(client: socket.socket) -> None:
    """Ask, and wait for the response."""
    client.sendall(read(1, 1))
    receive(client, RESPONSE_SIZE)


def vanish(client: socket.socket) -> None:
    """Nothing of this client arrives any more."""
    drop("sport", client)


def vanish_while_asking(client: socket.socket) -> None:
    """The gateway gets a request, and then nothing more, not even that the response came."""
    drop("dport", client)
    client.sendall(read(1, 1))
    time.sleep(0.1)
    drop("sport", client)


def closed_after(gateway: GatewayProcess, client: socket.socket) -> float:
    """Wait for the gateway to close this connection; how long it took, in seconds."""
    name, begin = f"127.0.0.1:{client.getsockname()[1]}", time.monotonic()
    while time.monotonic() < begin + 2 * CLOSED_WITHIN:
        for event in list(gateway.log):
            if (event["event"], event.get("client")) == ("client_closed", name):
                print(f"closed after {time.monotonic() - begin:.1f} s: {event['reason']}")
                return time.monotonic() - begin
        time.sleep(0.1)
    print(f"not closed within {2 * CLOSED_WITHIN:g} s")
    return inf


def check() -> int:
    """Both ways to vanish, one beside the other."""
    subprocess.run(["ip", "link", "set", "lo", "up"], check=True)
    with tempfile.TemporaryDirectory() as folder, GatewayProcess(Path(folder), CONFIG) as gateway:
        clients = [connect(gateway.port), connect(gateway.port)]
        for client in clients:
            ask(client)
        vanish(clients[0])
        vanish_while_asking(clients[1])
        with ThreadPoolExecutor() as pool:
            times = list(pool.map(partial(closed_after, gateway), clients))
        for _ in clients:
            ask(connect(gateway.port))
    return 0 if max(times) <= CLOSED_WITHIN else 1


if __name__ == "__main__":
    sys.exit(check() if INSIDE in sys.argv else in_a_namespace())
