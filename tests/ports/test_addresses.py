"""Several addresses of one server: each has its chance, and messages say what is wrong with each."""

import asyncio

import pytest

from gateway.errors import PortError
from gateway.ports.addresses import Addresses
from gateway.ports.reconnector import OPENING_DEADLINE
from gateway.ports.tcp import CONNECTING_DEADLINE


class Servers:
    """What each address does: answer after so many seconds, or fail for this reason."""

    def __init__(self, **does: float | str) -> None:
        self.does = does
        self.tried: list[str] = []
        self.moves: list[str] = []
        self.addresses = Addresses({name: self._opener(name) for name in does})
        self.addresses.moved = self.moves.append

    def _opener(self, name: str):
        async def open_port(_user: object) -> str:
            self.tried.append(name)
            does = self.does[name]
            if isinstance(does, str):
                raise PortError(f"{name} {does}")
            await asyncio.sleep(does)
            return f"port {name}"

        return open_port

    async def open(self) -> str:
        """What is opened, or why nothing is."""
        try:
            async with asyncio.timeout(self.addresses.deadline):
                return str(await self.addresses.open(None))
        except PortError as error:
            return str(error)
        except TimeoutError:
            return "the deadline"


async def test_the_first_one_that_can_be_reached_is_used_from_then_on() -> None:
    servers = Servers(a="refuses", b=0.1, c=0.1)
    assert [await servers.open() for _ in range(2)] == ["port b", "port b"]
    assert servers.tried == ["a", "b", "b"]
    assert servers.moves == ["b"]
    servers.does["b"] = "refuses too"
    assert await servers.open() == "port c"
    servers.does |= {"c": "is off", "a": 0.1}
    assert await servers.open() == "port a"
    assert servers.moves == ["b", "c", "a"]


async def test_a_failure_of_all_is_said_the_same_whoever_is_first() -> None:
    servers = Servers(a="refuses", b=1e6, c="is off")
    said = {await servers.open() for _ in range(3)}
    assert len(said) <= 2
    assert "a refuses; b does not answer: is it on, and does every firewall let us through?; c is off" in said


async def test_one_that_does_not_answer_leaves_the_others_time() -> None:
    servers = Servers(a=1e6, b=1e6, c=CONNECTING_DEADLINE - 0.1)
    began = asyncio.get_running_loop().time()
    assert await servers.open() == "port c"
    assert asyncio.get_running_loop().time() - began < 2 * CONNECTING_DEADLINE


async def test_each_is_the_last_one_of_some_attempt_and_has_the_whole_time_then() -> None:
    for slow in ("a", "b", "c"):
        servers = Servers(**{"a": 1e6, "b": 1e6, "c": 1e6, slow: CONNECTING_DEADLINE - 0.1})
        assert f"port {slow}" in [await servers.open() for _ in range(3)]


@pytest.mark.parametrize("after_connect", [0.0, 3.0])
async def test_a_single_address_has_the_time_of_a_port(after_connect: float) -> None:
    addresses = Addresses({"a": lambda _user: asyncio.sleep(0)}, after_connect)
    assert addresses.deadline == OPENING_DEADLINE + after_connect
    assert not addresses.are_several
