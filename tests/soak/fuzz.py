"""Every decoder against bytes of all kinds: frames, damaged frames, noise, and the three in any mixture.

    .venv/bin/python tests/soak/fuzz.py --seconds 60 --seed 1

Two promises are checked. A decoder raises nothing but what it declares. And however the bytes are cut into chunks, the
same comes out. Ends with status 0 if both were kept; otherwise the input is printed that broke one.

The properties in tests/modbus are the same ones, tried for a short time in each test run.
"""

import argparse
import random
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[1]))

from gateway.errors import NotModbus, RequestError
from gateway.modbus import ascii as ascii_framing
from gateway.modbus import mbap, rtu
from gateway.modbus.pdu import RequestPdu, parse_request
from gateway.modbus.scan_rtu import RtuScanner
from kit.asked import SILENCE, Asked
from kit.asker import Asker
from kit.noise import random_chunks
from kit.upstream_bench import UpstreamBench

#: What comes out of a decoder, in words that can be compared.
Outcome = list[object]
Decode = Callable[[Sequence[bytes]], Outcome]

UNITS: Final = (0, 1, 17, 247)
#: No input is longer, in bytes: some frames of the longest kind.
LONGEST: Final = 900

REQUESTS: Final = [
    bytes.fromhex(pdu)
    for pdu in (
        "01 0000 0010", "02 0013 0001", "03 0010 0001", "03 0000 007D", "04 0008 0002", "05 00AC FF00", "06 0001 0003",
        "0F 0013 000A 02 CD01", "10 0001 0002 04 000A 0102", "16 0004 00F2 0025", "17 0003 0002 000E 0001 02 00FF",
        "41 01 02 03", "2B 0E 01 00", "2B 0E 04 02", "11", "0C", "18 04DE", "08 0000 A537", "08 000B 0000", "07", "0B",
        "14 0E 06 0004 0001 0002 06 0003 0009 0001", "15 09 06 0004 0007 0001 06AF", "08 0015 0001", "2B 0D 01",
    )
]  # fmt: skip


class Bytes:
    """Makes inputs that look like what a decoder may meet."""

    def __init__(self, seed: int) -> None:
        self.dice = random.Random(seed)

    def pdu(self) -> bytes:
        """A request, a response to one, an exception, or anything."""
        dice, kind = self.dice, self.dice.randrange(5)
        request = dice.choice(REQUESTS)
        if kind == 0:
            return request
        if kind == 1:
            return bytes((request[0] | 0x80, dice.randrange(12)))
        if kind == 2:
            size = dice.choice((1, 2, 2, 4, 8, 250))
            return bytes((dice.choice((1, 2, 3, 4, 23)), size)) + dice.randbytes(size)
        if kind == 3:
            return request[:5]
        return dice.randbytes(dice.choice((1, 2, 5, 5, dice.randint(1, 253))))

    def response(self, asked: RequestPdu) -> bytes:
        """An answer to `asked` as it should be."""
        if asked.response_size is None:
            return asked.response_head + self.rest_of_response(asked)
        return asked.response_head + self.dice.randbytes(asked.response_size - len(asked.response_head))

    def rest_of_response(self, asked: RequestPdu) -> bytes:
        """Behind its head; most of those that tell their own size tell the right one."""
        data = self.dice.randbytes(self.dice.choice((0, 1, 2, 6, 20, 64)))
        if asked.function in {12, 17}:
            return bytes((len(data),)) + data
        if asked.function == 24:
            return (2 + len(data)).to_bytes(2, "big") + (len(data) // 2).to_bytes(2, "big") + data
        if asked.data[:2] == b"\x2b\x0e":
            return bytes((1, 0, 0, 2, 0, len(data))) + data + bytes((asked.data[3], 1, 65))
        return data

    def mixture(self, frame: Callable[[], bytes]) -> bytes:
        """Some frames with noise around them, some of them cut, doubled or damaged."""
        dice, parts = self.dice, []
        for _ in range(dice.randint(1, 5)):
            data = frame()
            kind = dice.randrange(8)
            if kind == 0:
                data = data[: dice.randint(0, len(data))]
            elif kind == 1:
                data = data[dice.randint(0, len(data)) :]
            elif kind == 2 and data:
                at = dice.randrange(len(data))
                data = data[:at] + bytes((data[at] ^ 1 << dice.randrange(8),)) + data[at + 1 :]
            elif kind == 3:
                at = dice.randint(0, len(data))
                data = data[:at] + frame() + data[at:]
            elif kind == 4:
                data = dice.randbytes(dice.choice((1, 2, 3, 30, 300)))
            parts.append(data)
        return b"".join(parts)[:LONGEST]


def mbap_stream(data: Bytes) -> tuple[bytes, Decode]:
    """A client's or a server's stream; what it declares is NotModbus, and nothing comes after that."""
    strict = data.dice.random() < 0.5

    def frame() -> bytes:
        adu = mbap.encode(data.dice.randrange(65536), data.dice.choice(UNITS), data.pdu())
        return adu if data.dice.random() < 0.9 else adu[:2] + data.dice.randbytes(4) + adu[6:]

    def decode(chunks: Sequence[bytes]) -> Outcome:
        framer, outcome = mbap.MbapFramer(strict=strict), Outcome()
        try:
            for chunk in chunks:
                outcome.extend(framer.cut(chunk))
        except NotModbus as error:
            return [*outcome, str(error)]
        return [*outcome, framer.unfinished]

    return data.mixture(frame), decode


def upstream(data: Bytes) -> tuple[bytes, Decode]:
    """What another server says to requests that are under way; each client gets an answer to its own or none."""
    asked = [data.dice.choice(REQUESTS) for _ in range(8)]

    def frame() -> bytes:
        number = data.dice.randrange(len(asked))
        pdu = data.response(parse_request(asked[number])) if data.dice.random() < 0.7 else data.pdu()
        adu = mbap.encode(1 + number, data.dice.choice((7, 7, 7, *UNITS)), pdu)
        return adu if data.dice.random() < 0.95 else adu[:2] + data.dice.randbytes(4) + adu[6:]

    def decode(chunks: Sequence[bytes]) -> Outcome:
        bench, outcome = UpstreamBench(), Outcome()
        clients = [Asker(str(number)) for number in range(len(asked))]
        for client, pdu in zip(clients, asked, strict=True):
            bench.ask(pdu.hex(), client=client)
        try:
            for chunk in chunks:
                bench.hear(chunk)
        except NotModbus as error:
            outcome.append(str(error))
        bench.upstream.port_down(bench.now)
        for client, pdu in zip(clients, asked, strict=True):
            (answer,) = client.answers
            assert parse_request(pdu).accepts(bytes.fromhex(answer))
            outcome.append(answer)
        return outcome

    return data.mixture(frame), decode


def rtu_response(data: Bytes) -> tuple[bytes, Decode]:
    """The response to a request; what the line takes is the first frame that fits."""
    asked = parse_request(data.dice.choice(REQUESTS))
    unit = data.dice.choice((17, 17, None))

    def frame() -> bytes:
        pdu = data.response(asked) if data.dice.random() < 0.5 else data.pdu()
        return rtu.encode(data.dice.choice((17, 17, *UNITS)), pdu)

    def decode(chunks: Sequence[bytes]) -> Outcome:
        framer = Asked(unit, asked)
        for chunk in chunks:
            fitting = framer.received(chunk, 0.0)
            if fitting:
                return fitting[:1]
        return [*framer.tick(SILENCE), framer.conclude(), framer.heard_noise]

    return data.mixture(frame), decode


def rtu_request(data: Bytes) -> tuple[bytes, Decode]:
    """What a server on a line hears, up to a silence."""

    def decode(chunks: Sequence[bytes]) -> Outcome:
        framer = rtu.RtuFramer(SILENCE)
        frames = [frame for chunk in chunks for frame in framer.received(chunk, 0.0)]
        return [*frames, *framer.tick(SILENCE)]

    return data.mixture(lambda: rtu.encode(data.dice.choice(UNITS), data.pdu())), decode


def rtu_shared_line(data: Bytes) -> tuple[bytes, Decode]:
    """What a server hears on a line with other servers, up to a silence."""
    asked = parse_request(data.dice.choice(REQUESTS))

    def frame() -> bytes:
        pdu = data.response(asked) if data.dice.random() < 0.5 else data.pdu()
        return rtu.encode(data.dice.choice(UNITS), pdu)

    def decode(chunks: Sequence[bytes]) -> Outcome:
        framer = rtu.RtuFramer(SILENCE, ours=frozenset({17}))
        frames = [frame for chunk in chunks for frame in framer.received(chunk, 0.0)]
        return [*frames, *framer.tick(SILENCE), framer.behind, framer.heard_noise]

    return data.mixture(frame), decode


def rtu_overheard(data: Bytes) -> tuple[bytes, Decode]:
    """Frames that pass on a line while nobody asks."""

    def decode(chunks: Sequence[bytes]) -> Outcome:
        scanner = RtuScanner(SILENCE)
        return [(token.start, token.end) for chunk in chunks for token in scanner.received(chunk, 0.0)]

    return data.mixture(lambda: rtu.encode(data.dice.choice(UNITS), data.pdu())), decode


def ascii_stream(data: Bytes) -> tuple[bytes, Decode]:
    """An ASCII line, either direction."""

    def frame() -> bytes:
        adu = ascii_framing.encode(data.dice.choice(UNITS), data.pdu())
        kind = data.dice.randrange(6)
        if kind == 0:
            return adu.lower()
        if kind == 1:
            return adu[:-2] + data.dice.choice((b"\r", b"\n", b"\r\r\n", b":", b"\0\r\n"))
        return adu

    def decode(chunks: Sequence[bytes]) -> Outcome:
        framer = ascii_framing.AsciiFramer()
        frames = [frame for chunk in chunks for frame in framer.received(chunk, 0.0)]
        return [*frames, *framer.tick(2.0), framer.behind, framer.heard_noise]

    return data.mixture(frame), decode


def request_pdu(data: Bytes) -> tuple[bytes, Decode]:
    """A request PDU in one piece; what it declares is RequestError."""

    def decode(chunks: Sequence[bytes]) -> Outcome:
        pdu = b"".join(chunks)
        try:
            asked = parse_request(pdu)
        except RequestError as error:
            return [error.code]
        return [asked, asked.accepts(pdu), asked.accepts(pdu[:2])]

    return data.mixture(data.pdu) or b"\0", decode


DECODERS: Final = (
    *(mbap_stream, upstream, request_pdu, ascii_stream),
    *(rtu_response, rtu_request, rtu_shared_line, rtu_overheard),
)


@dataclass
class Result:
    """What came of one decoder."""

    decoder: str
    inputs: int = 0
    findings: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        return f"{self.decoder:16}{self.inputs:>12} inputs{len(self.findings):>8} findings"


def fuzz(number: int, seconds: float, seed: int) -> Result:
    """One decoder for so long."""
    make = DECODERS[number]
    result, data = Result(make.__name__), Bytes(seed)
    end = time.monotonic() + seconds
    while time.monotonic() < end and len(result.findings) < 5:
        for _ in range(100):
            _try(make, data, result)
    return result


def _try(make: Callable[[Bytes], tuple[bytes, Decode]], data: Bytes, result: Result) -> None:
    given, decode = make(data)
    result.inputs += len(SPLITS)
    finding = examine(given, decode, seed=data.dice.randrange(1 << 30))
    if finding:
        result.findings.append(f"{result.decoder}: {finding}")


def examine(given: bytes, decode: Decode, seed: int) -> str:
    """Decode `given` in one piece, byte by byte, and cut anyhow; what was broken, empty if nothing."""
    outcomes = []
    for split in SPLITS:
        chunks = split(given, seed)
        try:
            outcomes.append(decode(chunks))
        except Exception as error:  # noqa: BLE001 - that is what is looked for
            return f"{error!r} for {[chunk.hex() for chunk in chunks]}"
        if outcomes[-1] != outcomes[0]:
            cut = [chunk.hex() for chunk in chunks]
            return f"{given.hex()}: {outcomes[0]}, but {outcomes[-1]} for {cut}"
    return ""


#: The ways to cut an input.
SPLITS: Final[tuple[Callable[[bytes, int], list[bytes]], ...]] = (
    lambda given, _: [given],
    lambda given, _: [bytes((byte,)) for byte in given],
    random_chunks,
)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=60.0, help="for each decoder")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=1, help="processes")
    args = parser.parse_args()
    many = len(DECODERS)
    with ProcessPoolExecutor(args.jobs) as pool:
        results = list(pool.map(fuzz, range(many), [args.seconds] * many, range(args.seed, args.seed + many)))
    for result in results:
        print(result, *result.findings, sep="\n  ")
    return 1 if any(result.findings for result in results) else 0


if __name__ == "__main__":
    sys.exit(main())
