"""Every frame printed in the manufacturers' documents, byte for byte through the whole gateway, both ways."""

from itertools import pairwise

import pytest

from kit.gateway_bench import gateway_bench
from kit.vectors import SeedFrame, meaning, seed_frames

CONFIG = """
[[line]]
name = "line"
port = "/dev/line"
baud = 9600
"""

PRINTED = [frame for frame in seed_frames() if frame.mode == "rtu"]
EXCHANGES = [
    pytest.param(request.data, response.data, id=request.meaning)
    for request, response in pairwise(PRINTED)
    if request.kind == "request" and response.kind == "response" and request.data[0] == response.data[0]
]
REQUESTS = [frame for frame in PRINTED if frame.kind == "request" and frame.data[0] > 0]
MISPRINTS = [frame for frame in PRINTED if frame.kind == "misprint"]


@pytest.mark.parametrize(("request_adu", "response_adu"), EXCHANGES)
async def test_a_printed_exchange_passes_unchanged(request_adu: bytes, response_adu: bytes) -> None:
    async with gateway_bench(CONFIG) as bench:
        client, line = bench.client(), bench.lines["line"]
        client.ask(request_adu[0], request_adu[1:-2].hex())
        assert line.take_written() == request_adu
        line.deliver(response_adu)
        assert bytes.fromhex(await client.answer()) == response_adu[1:-2]


@pytest.mark.parametrize("frame", REQUESTS, ids=meaning)
async def test_a_printed_request_goes_on_the_line_as_printed(frame: SeedFrame) -> None:
    async with gateway_bench(CONFIG) as bench:
        bench.client().ask(frame.data[0], frame.data[1:-2].hex())
        assert bench.lines["line"].take_written() == frame.data


@pytest.mark.parametrize("frame", MISPRINTS, ids=meaning)
async def test_a_misprint_is_no_answer(frame: SeedFrame) -> None:
    async with gateway_bench(CONFIG) as bench:
        client, line = bench.client(), bench.lines["line"]
        client.ask(frame.data[0], "03 0000 0002")
        line.deliver(frame.data)
        assert await client.answer() == "83 0B"
