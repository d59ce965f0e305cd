"""What holds for all tests: the clock they run by, their order, and how hard hypothesis tries."""

import asyncio
import gc
import os
import signal
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import hypothesis
import pytest
from xdist.scheduler import LoadScopeScheduling

import gateway
from gateway.clock.exact_loop import new_exact_loop
from kit.one_demo import set_of
from kit.virtual_time import VirtualTimeLoop

pytest_plugins = ["kit.left_out"]

gc.disable()  # until all tests are collected, which takes a sixth longer otherwise
_TESTS = Path(__file__).parent
#: Folders whose tests meet sockets, terminals and processes: they run in real time, after all others.
_REAL_TIME = frozenset({"system", "bench"})
#: Files that take longest, in that order: none of these shall begin last.
_LONGEST = (
    *("test_accepted_configs", "test_pages_in_browser", "test_traffic_page", "test_systemd", "test_web_api"),
    *("test_tutorials", "test_fleet"),
    *("test_standby", "test_standing_still", "test_upstream", "test_manners"),
    *("test_scan", "test_doctor", "test_history", "test_tls", "test_demo", "test_kiosk"),
    *("test_flood", "test_logins_in_browser", "test_overview_page", "test_tcp", "test_writing_page", "test_strip"),
    *("test_moving_listeners", "test_read_write", "test_plant_forms", "test_run", "test_control", "test_store"),
    *("test_device_server", "test_trace", "test_go", "test_mqtt", "test_bench", "test_wheel"),
)
#: Files whose tests share nothing, and wait long: with `--dist loadfile` each of these tests goes to the next worker.
_APART = frozenset({"test_tutorials", "test_fleet", "test_doctor", "test_scan"})

#: Processes run the gateway that the tests import: that of the checkout, or a compiled one that is installed.
os.environ["PYTHONPATH"] = str(Path(gateway.__file__).parents[1])

#: Folders of tests hold sockets, and the path of a socket has at most 107 bytes, 80 of which pytest and the tests take.
if len(tempfile.gettempdir()) > 20:
    os.environ["TMPDIR"] = tempfile.tempdir = "/tmp"

#: A shell that starts the tests in the background has this ignored, and so have all processes behind it.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

_at_any_pace = {"deadline": None, "suppress_health_check": [hypothesis.HealthCheck.too_slow]}
hypothesis.settings.register_profile("dev", **_at_any_pace, max_examples=15)  # others each time
hypothesis.settings.register_profile("ci", **_at_any_pace, derandomize=True, print_blob=True, max_examples=50)
# With the oldest libraries: --hypothesis-profile=quick
hypothesis.settings.register_profile("quick", **_at_any_pace, derandomize=True, print_blob=True, max_examples=15)
hypothesis.settings.load_profile("ci" if os.environ.get("CI") else "dev")


def pytest_asyncio_loop_factories(item: pytest.Item) -> Mapping[str, Callable[[], asyncio.AbstractEventLoop]]:
    if _in_real_time(item):
        return {"real-time": new_exact_loop}
    return {"virtual-time": VirtualTimeLoop}


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    items.sort(key=_order)  # stable: otherwise as collected
    if os.environ.get("CI"):  # a busy machine may be late once; the summary tells what passes only the second time
        once_more = pytest.mark.flaky(reruns=1, rerun_except="from pytest-timeout")  # that limits both runs as one
        for item in filter(_in_real_time, items):
            item.add_marker(once_more)


class _ByFile(LoadScopeScheduling):
    def _split_scope(self, nodeid: str) -> str:
        file = Path(nodeid.partition("::")[0])
        if file.stem in _APART:
            return nodeid
        return " ".join(sorted(set_of(file)))


@pytest.hookimpl(optionalhook=True)  # mutation testing runs without xdist
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadScopeScheduling | None:
    return _ByFile(config, log) if config.getvalue("dist") == "loadfile" else None


def pytest_collection_finish() -> None:
    gc.collect()
    gc.enable()
    gc.freeze()  # thousands of tests that stay: each collection would look at them again
    gc.set_threshold(50_000, 20, 20)  # the usual one costs a twelfth of all processor time


def _order(item: pytest.Item) -> tuple[bool, int]:
    file = item.path.stem
    return _in_real_time(item), _LONGEST.index(file) if file in _LONGEST else len(_LONGEST)


def _in_real_time(item: pytest.Item) -> bool:
    return item.path.relative_to(_TESTS).parts[0] in _REAL_TIME
