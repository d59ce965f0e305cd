"""What to do first: three steps, with commands that work as they stand. `modbus-gateway` without a command prints them.

The Debian package ends its installation with them. They fit what is there: its config and service, or no config yet.
"""

import os
import shlex
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Final

from gateway.config.machine.included import written_in
from gateway.hardware.listing import list_serial_ports
from gateway.readconfig.libraries import missing_library, not_installed

_PAGE: Final = "http://127.0.0.1:8502"
#: Where a port is that nobody has found yet.
_SOME_PORT: Final = "/dev/ttyUSB0"
#: Before what is built in, which most machines have, and few use.
_ADAPTERS: Final = "/dev/serial/"
#: The usual ones; the manual of a device says its own.
_RATE: Final = "--baud 9600 --format 8N1"
_LOOPBACK: Final = ("127.0.0.1", "localhost", "[::1]")
_OWN_CONFIG: Final = Path("gateway.toml")
_PAGE_TABLE: Final = f'[web]\nbind = "{_PAGE}"'


def first_steps(service_config: Path) -> str:
    """Say what to do first. With this config there is a service; else the gateway is run by hand."""
    paths = [port.path for port in list_serial_ports()]
    port = next((path for path in paths if path.startswith(_ADAPTERS)), paths[0] if paths else _SOME_PORT)
    steps = _with_service(service_config, port) if service_config.exists() else _by_hand(port)
    return "\n\n".join(["First steps:", *(f"{number}. {step}" for number, step in enumerate(steps, 1))])


def _with_service(config: Path, port: str) -> Iterator[str]:
    page, _ = written_in(config, "web", "bind")
    if page:
        yield f"Open the page: {page}{_from_elsewhere(page)}"
    else:
        yield f"Let there be a page: write this into {config}\n\n{_PAGE_TABLE}"
    yield _find(port, "sudo ")
    yield (
        f"Enter the port in [[line]] of {config}; check it, and apply it:\n\n"
        f"sudoedit {shlex.quote(str(config))}\nmodbus-gateway check\nsudo modbus-gateway reload"
    )


def _from_elsewhere(page: str) -> str:
    host, _, number = page.partition("://")[2].rpartition(":")
    if host not in _LOOPBACK:
        return ""
    return (
        "\n   From another machine the same, after this command there:\n\n"
        f"ssh -N -L {number}:{host}:{number} {os.environ.get('SUDO_USER', 'USER')}@{socket.gethostname()}"
    )


def _by_hand(port: str) -> Iterator[str]:
    missing = missing_library("web")
    if missing is None:
        yield "See it work on simulated lines, with a page, until Ctrl-C:\n\nmodbus-gateway demo"
    else:
        yield (
            "See it work on simulated lines, until Ctrl-C:\n\nmodbus-gateway demo\n\n"
            f"   For its page: {not_installed(missing, 'web')}"
        )
    yield _find(port, "")
    page = f"; its page is then {_PAGE}" if missing is None else ""
    yield f"Write {_OWN_CONFIG}, check it, run it{page}:\n\n" + "\n".join(_own_config(port, has_page=missing is None))


def _find(port: str, sudo: str) -> str:
    return (
        "Find your port, and the units that answer there. Rate and format are in their manual:\n\n"
        f"modbus-gateway ports\n{sudo}modbus-gateway scan 1-20 --port {shlex.quote(port)} {_RATE}"
    )


def _own_config(port: str, *, has_page: bool) -> Iterator[str]:
    """Write the commands that make a config and run it. They overwrite none."""
    if not _OWN_CONFIG.exists():
        yield f"cat > {_OWN_CONFIG} << 'END'"
        yield f'[[listen]]\nbind = "tcp://127.0.0.1:5020"\n\n[[line]]\nport = "{port}"\nbaud = 9600\nformat = "8N1"'
        if has_page:
            yield f"\n{_PAGE_TABLE}"
        yield "END"
    yield f"modbus-gateway check {_OWN_CONFIG}\nmodbus-gateway run {_OWN_CONFIG}"
