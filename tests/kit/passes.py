"""What runs side by side: the jobs of `nox -s tests`, of `nox -s check`, and those of CI."""

from pathlib import Path
from typing import Final

from kit.side_by_side import Job

_VENV: Final = Path(__file__).parents[2] / ".venv"
#: Where it is noted which tests were left out.
LEFT_OUT: Final = _VENV / "left-out"

#: What meets compiled modules. The rest is what these cannot break: which files are accepted, commands, pages.
_REQUEST_PATH: Final = (
    *("tests/clock", "tests/devices", "tests/fleet/test_lease_orders.py", "tests/hardware", "tests/images"),
    *("tests/library", "tests/lines", "tests/listeners", "tests/modbus", "tests/model", "tests/operator"),
    *("tests/ports", "tests/registers", "tests/routing", "tests/runtime", "tests/service", "tests/stories"),
    *("tests/timing", "tests/tools", "tests/trace", "tests/upstreams"),
)
_REST: Final = ("tests", "--ignore", "tests/system", *(word for path in _REQUEST_PATH for word in ("--ignore", path)))
_ONCE: Final = ("-m", "not search or interpreted")
#: What replaces a method or a constant, which compiled modules do not allow.
_INTERPRETED: Final = ("-m", "interpreted")
#: What is installed is tested, in place of the checkout.
_INSTALLED: Final = ("-o", "pythonpath=tests", "-m", "not interpreted")

#: For an environment of their own: each test in virtual time, and those of them that meet compiled modules.
VIRTUAL: Final = ("tests", "--ignore", "tests/system", *_ONCE)
COMPILED: Final = (*_REQUEST_PATH, "-o", "pythonpath=tests deploy", "-m", "not search and not interpreted")
#: What meets a library in a way of its own.
LOWEST: Final = (
    *("--numprocesses", "2", "--dist", "loadfile", "-m", "not search", "--hypothesis-profile=quick"),
    *("-r", "fER", "--rerun-show-tracebacks"),
    *("tests/cli/units", "tests/config/importing", "tests/config/schema", "tests/config/test_examples.py"),
    *(f"tests/fleet/test_{name}.py" for name in ("bucket", "connection", "serving")),
    *("tests/modbus/test_rtu_request.py", "tests/observe", "tests/ports"),
    *(f"tests/plant/test_{name}.py" for name in ("broker", "publishing", "sparkplug_payload")),
    *("tests/web/access/test_access.py", "tests/web/api/test_api.py"),
    *(f"tests/web/front/test_{name}.py" for name in ("connections", "hostile_requests", "streams")),
    *(f"tests/system/test_{name}.py" for name in ("fleet_connection", "mqtt_connection", "serial_pty", "web")),
)

_PYTEST: Final = ("pytest", "--left-out", str(LEFT_OUT), "-r", "fER", "--rerun-show-tracebacks")
#: Without what captures Python's logging, which none of these reads, and which costs a twentieth.
_COMPUTES: Final = (*_PYTEST, "-p", "no:logging")
#: These wait most of the time. Those of one file may share what they set up; long ones begin first: tests/conftest.py.
_WAITS: Final = (*_PYTEST, "--numprocesses", "6", "--dist", "loadfile", "--no-loadscope-reorder")


def of_tests() -> list[Job]:
    """List all tests, without searches."""
    return [
        Job("system tests", (*_WAITS, "tests/system", "-m", "not search"), waits=True, live=True),
        Job("request path", (*_COMPUTES, *_REQUEST_PATH, *_ONCE)),
        Job("rest", (*_COMPUTES, *_REST, *_ONCE)),
    ]


def of_check() -> list[Job]:
    """List the checks of the code, and all tests."""
    return [_session("lint", decides=True), _session("types", decides=True), *of_tests()]


def of_ci() -> list[Job]:
    """List the same with searches, the request path compiled, and what nobody else waits for.

    What meets compiled modules runs with these, and not a second time without. It takes longest, so what is short waits
    until it has begun.
    """
    pure = (word for path in _COMPILED_SYSTEM for word in ("--ignore", path))
    return [
        Job("system tests", (*_WAITS, "tests/system", *pure), waits=True, live=True),
        Job("compile", ("deploy/go", "compile"), waits=True),  # others wait for it
        _session("lint", decides=True),
        Job("rest", (*_COMPUTES, *_REST, *_ONCE)),
        Job("compiled", (*_COMPUTES, *_REQUEST_PATH, *_INSTALLED), after="compile"),
        Job("interpreted", (*_COMPUTES, *_REQUEST_PATH, *_INTERPRETED), after="compile"),
        *(_session(name, after="compile") for name in ("types", "stale", "docs", "audit")),
        _session("lowest", after="system tests"),
        Job("system tests, compiled", (*_WAITS, *_INSTALLED, *_COMPILED_SYSTEM), after="compiled", waits=True),
        Job("system tests, interpreted", (*_WAITS, *_INTERPRETED, *_COMPILED_SYSTEM), after="system tests", waits=True),
        Job("instructions", ("python", "tests/bench/instructions.py", *_WAYS, "--check"), after="compiled"),
        Job("growth", ("python", "tests/bench/growth.py", "--check"), after="compiled"),
    ]


_COMPILED_SYSTEM: Final = tuple(
    f"tests/system/test_{name}.py"
    for name in ("exact_loop", "run", "serial_pty", "server_lines", "tcp", "tcp_stream", "udp")
)
_WAYS: Final = ("image", "mirror", "virtual", "line")


def _session(name: str, *, after: str = "", decides: bool = False) -> Job:
    return Job(name, ("nox", "--session", name), after=after, decides=decides)
