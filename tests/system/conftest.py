"""What holds for all tests in real time."""

import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from kit.chromium import chromium, demo_page
from kit.one_demo import Shared, set_of
from kit.process import prepared

#: The project of somebody else: test_wheel.py runs its tests.
collect_ignore = ["project"]
#: Those that a demo takes if nobody listens there: of its clients, its page, its secured clients.
DEMO_PORTS = (5020, 8502, 8802)


@pytest.fixture(scope="session", autouse=True)
def _no_two_demos_want_one_port() -> Iterator[None]:
    """Demos that begin at the same moment would each find these free: so somebody listens there, in every worker."""
    with ExitStack() as stack:
        for number in DEMO_PORTS:
            door = stack.enter_context(socket.socket())
            door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
            with suppress(OSError):  # somebody else does
                door.bind(("127.0.0.1", number))
                door.listen()
        yield


@pytest.fixture(scope="session", autouse=True)
def _processes_are_prepared(testrun_uid: str) -> Iterator[None]:
    """Hundreds start."""
    with prepared(testrun_uid):
        yield


@pytest.fixture(scope="session")
def _of_a_set() -> Iterator[Shared]:
    shared = Shared()
    yield shared
    shared.begin(frozenset())


@pytest.fixture(scope="module", autouse=True)
def _shared(_of_a_set: Shared, request: pytest.FixtureRequest) -> Shared:
    """What the files of a set share; what those before shared ends, whatever this file needs."""
    _of_a_set.begin(set_of(request.path))
    return _of_a_set


@pytest.fixture(scope="module")
def browser(_shared: Shared) -> Any:
    """A Chromium."""
    return _shared.get(chromium)


@pytest.fixture(scope="module")
def address(_shared: Shared) -> Any:
    """The address of the page of a demo."""
    return _shared.get(demo_page)
