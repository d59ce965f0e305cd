"""What a client is told when it asks for what is not there, the log says too: who, what and why."""

import pytest

from gateway.events import RequestRefused
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name    = "hall-a"
port    = "/dev/hall-a"
mode    = "ascii"
devices = [{ unit = 2, as = 52, name = "axis-1", profile = "mint" }]

[[image]]
unit    = 200
name    = "shift-data"
holding = 10

[[image]]
unit    = 201
of      = "axis-1"
read    = [{ holding = "1-2", every = "1 s" }]

[[image]]
unit    = 202
name    = "block"
holding = "8"
map     = [
    { at = 0, device = "shift-data", holding = "0-1", every = "1 s" },
    { at = 4, device = "shift-data", holding = "2-3", every = "1 s" },
]
"""
CLIENT = "10.0.0.9:49152"


@pytest.mark.parametrize(
    ("unit", "name", "pdu", "code", "why"),
    [
        (9, "", "03 0000 0001", "0A", "no such unit"),
        (52, "axis-1", "04 0001 0001", "01", "profile mint has no function 4"),
        (52, "axis-1", "03 0000 0001", "02", "profile mint has no holding 0"),
        (52, "axis-1", "03 0001 0064", "03", "profile mint allows 99 items of function 3"),
        (52, "axis-1", "05 0000 1234", "03", "function 05: a coil is FF00 or 0000: 05 00 00 12 34"),
        (200, "shift-data", "03 000A 0001", "02", "shift-data has no holding 10"),
        (201, "image-201", "03 0003 0001", "02", "image-201 does not poll all of holding 3"),
        (202, "block", "03 0000 0006", "02", "block has no holding 2-3"),
        (202, "block", "03 0005 0009", "02", "block has no holding 6-7"),
        (202, "block", "03 0008 0003", "02", "block has no holding 9-10"),
        (202, "block", "06 0006 0001", "02", "block has no holding 6"),
    ],
)
async def test_a_refusal_is_told(unit: int, name: str, pdu: str, code: str, why: str) -> None:
    async with gateway_bench(CONFIG) as bench:
        function = int(pdu[:2], 16)
        assert await bench.client(CLIENT).asks(unit, pdu) == f"{function | 0x80:02X} {code}"
        told = [event for event in bench.events if isinstance(event, RequestRefused)]
        listener = "" if name else bench.gateway.listeners[0].settings.name
        assert told == [RequestRefused(CLIENT, unit, function, code, why, listener, name)]


async def test_what_the_unit_answers_is_no_refusal() -> None:
    async with gateway_bench(CONFIG) as bench:
        assert await bench.client(CLIENT).asks(200, "03 0000 0001") == "03 02 00 00"
        assert not any(isinstance(event, RequestRefused) for event in bench.events)
