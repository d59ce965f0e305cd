"""What holds for all tests: the clock they run by, their order, and how hard hypothesis tries."""

import asyncio
import gc
import os
import signal
from collections.abc import Callable, Mapping
from pathlib import Path

import hypothesis
import pytest

import gateway
from gateway.ports.exact_loop import exact_loop
from kit.virtual_time import VirtualTimeLoop

pytest_plugins = ["kit.skips"]

_TESTS = Path(__file__).parent
#: Folders whose tests meet sockets, terminals and processes: they run in real time, after all others.
_REAL_TIME = frozenset({"system", "bench"})

#: Processes run the gateway that the tests import: that of the checkout, or a compiled one that is installed.
os.environ["PYTHONPATH"] = str(Path(gateway.__file__).parents[1])

#: A shell that starts the tests in the background has this ignored, and so have all processes behind it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

hypothesis.settings.register_profile("dev", deadline=None)
hypothesis.settings.register_profile("ci", deadline=None, derandomize=True, print_blob=True)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")


def pytest_asyncio_loop_factories(item: pytest.Item) -> Mapping[str, Callable[[], asyncio.AbstractEventLoop]]:
    if _in_real_time(item):
        return {"real-time": exact_loop}
    return {"virtual-time": VirtualTimeLoop}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=_in_real_time)  # stable: otherwise as collected


def pytest_collection_finish() -> None:
    gc.collect()
    gc.freeze()  # thousands of tests that stay: each collection would look at them again


def _in_real_time(item: pytest.Item) -> bool:
    return item.path.relative_to(_TESTS).parts[0] in _REAL_TIME
