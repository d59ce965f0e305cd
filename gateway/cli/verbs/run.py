"""`run`: the gateway in the foreground."""

import argparse
import faulthandler
import resource
import sys
from pathlib import Path
from typing import Any

from gateway.cli.main import DEFAULT_CONFIG, FINE, PROBLEM_FOUND
from gateway.errors import ConfigError
from gateway.readconfig.process import ConfigProcess


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `run`."""
    parser.add_argument("--control", metavar="PATH", help="path of the control socket; overrides the config")
    parser.add_argument("config", nargs="?", default=DEFAULT_CONFIG, help=f"the config file (default {DEFAULT_CONFIG})")


def run(args: argparse.Namespace) -> int:
    """Run until SIGTERM or SIGINT."""
    _dump_no_core()
    if sys.stderr is not None:
        faulthandler.enable()  # print a traceback if the watchdog ends the process
    file = Path(args.config)
    process = ConfigProcess(file)
    from gateway import events  # noqa: PLC0415 - all of the gateway, loaded while the process reads the config
    from gateway.service.daemon import run_daemon, tell_journal  # noqa: PLC0415 - see above

    try:
        read = process.result()
    except ConfigError as error:
        tell_journal(events.ConfigRejected.of(str(file), [str(error)]))
        raise
    if read.plan is None:
        tell_journal(events.ConfigRejected.of(str(file), read.errors))
        print(*read.problems, sep="\n", file=sys.stderr)
        return PROBLEM_FOUND
    run_daemon(file, read, read.plan, args.control, _unit_client)
    return FINE


def _unit_client(*arguments: Any) -> Any:
    """Make a UnitClient, for a unit made in Python; most gateways have none."""
    from gateway.library.unit_client import UnitClient  # noqa: PLC0415 - see above

    return UnitClient(*arguments)


def _dump_no_core() -> None:
    """Forbid core dumps, which would have private keys and passwords in them; the service's unit forbids them too."""
    soft, hard = resource.getrlimit(resource.RLIMIT_CORE)
    if soft:
        resource.setrlimit(resource.RLIMIT_CORE, (0, hard))
