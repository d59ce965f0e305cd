"""`ports`: the serial ports of this machine, each with the path to use in a config."""

import argparse
import json
from dataclasses import asdict

from gateway.cli.kit.columns import align
from gateway.cli.kit.paint import red
from gateway.hardware.listing import ListedPort, list_serial_ports

_HEADINGS = ("PORT", "DEVICE", "ADAPTER", "DRIVER", "STATE")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `ports`."""
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def run(args: argparse.Namespace) -> int:
    """List the ports. Always 0, also without any port."""
    ports = list_serial_ports()
    if args.json:
        print(json.dumps([asdict(port) for port in ports], indent=2, ensure_ascii=False))
    elif ports:
        print(align([_HEADINGS, *(_row(port) for port in ports)]))
        print(f'\nUse the path in the first column in the config: port = "{ports[0].path}"')
    else:
        print("No serial port found. Is the adapter plugged in? `dmesg` shows whether the kernel has found it.")
    return 0


def _row(port: ListedPort) -> tuple[str, ...]:
    return (port.path, port.device, port.description, port.driver, _state(port))


def _state(port: ListedPort) -> str:
    match port.state:
        case "free":
            return "free"
        case "in use":
            return f"in use {port.remark}"
        case "no permission":
            return red(f"no permission: {port.remark}")
