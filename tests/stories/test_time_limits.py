"""A silent Mint controller: each question gets the time that the document's table gives it, and not more."""

import pytest

from gateway.modbus.ascii import encode
from kit.device import SimulatedDevice, SimulatedLine
from kit.gateway_bench import gateway_bench

CONFIG = """
[[line]]
name    = "press"
port    = "/dev/press"
mode    = "ascii"
baud    = 19200
format  = "7E1"
devices = [{ unit = 2, profile = "mint" }, { unit = 3, profile = "mint", timeout = "80 ms" }]
"""

#: One character of 7E1 (start, seven bits, parity, stop) at 19200 baud; what the port may add.
CHARACTER = 10 / 19200
LATENCY = 0.005


def wire(pdu_size: int) -> float:
    """A colon, two digits for each byte of unit, PDU and LRC, CR LF."""
    return (1 + 2 * (pdu_size + 2) + 2) * CHARACTER


FC16_OF_99 = "10 0001 0063 C6" + "0000" * 99
FC23_OF_99 = "17 0001 0063 0001 0063 C6" + "0000" * 99


@pytest.mark.parametrize(
    ("pdu", "response_size", "table"),
    [
        pytest.param("03 0001 0001", 4, 0.010, id="FC03 of 1"),
        pytest.param("03 0001 0032", 102, 0.010 + 49 / 98 * 0.410, id="FC03 of 50"),
        pytest.param("03 0001 0063", 200, 0.420, id="FC03 of 99"),
        pytest.param("10 0001 0001 02 0000", 5, 0.010, id="FC16 of 1"),
        pytest.param(FC16_OF_99, 5, 0.240, id="FC16 of 99"),
        pytest.param("17 0001 0001 0001 0001 02 0000", 4, 0.014, id="FC23 of 1"),
        pytest.param(FC23_OF_99, 200, 0.500, id="FC23 of 99"),
        pytest.param("01 0000 0010", 4, 0.010, id="FC01 of 16"),
        pytest.param("05 0000 FF00", 5, 0.010, id="FC05"),
    ],
)
async def test_each_question_has_its_own_limit(pdu: str, response_size: int, table: float) -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        begin = client.now()
        assert await client.asks(2, pdu) == f"{int(pdu[:2], 16) | 0x80:02X} 0B"
        request_size = len(bytes.fromhex(pdu))
        limit = wire(response_size) + 1.5 * table + LATENCY
        assert client.came_at - begin == pytest.approx(wire(request_size) + limit, abs=1e-6)


async def test_a_time_out_of_the_device_stands_in_place_of_margin_and_table() -> None:
    async with gateway_bench(CONFIG) as bench:
        client = bench.client()
        begin = client.now()
        assert await client.asks(3, "03 0001 0063") == "83 0B"
        assert client.came_at - begin == pytest.approx(wire(5) + wire(200) + 0.080 + LATENCY, abs=1e-6)


async def test_an_answer_at_the_end_of_its_limit_still_counts() -> None:
    async with gateway_bench(CONFIG) as bench:
        device = SimulatedDevice(2)
        limit = wire(4) + 1.5 * 0.010 + LATENCY
        device.script.append([(wire(5) + limit - 1e-6, encode(2, bytes.fromhex("03 02 00 07")))])
        bench.attach("press", SimulatedLine("ascii", device))
        assert await bench.client().asks(2, "03 0001 0001") == "03 02 00 07"
