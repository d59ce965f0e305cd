"""Frames that pass on an RTU line: found wherever they begin and however they are cut, each once."""

import random

import pytest

from gateway.modbus.codes import MAX_PDU, MAX_RTU_ADU
from gateway.modbus.frame import Frame
from gateway.modbus.functions import request_size, response_size
from gateway.modbus.rtu import crc_fits, encode
from gateway.modbus.scan_rtu import RtuScanner
from kit.noise import chunkings, noise, random_chunks

REQUEST = Frame(1, bytes.fromhex("03 00 10 00 01"))
RESPONSE = Frame(1, bytes.fromhex("03 02 01 10"))
EXCEPTION = Frame(2, bytes.fromhex("83 02"))
WRITE = Frame(9, bytes.fromhex("10 00 01 00 02 04 00 01 00 02"))
ALL = [REQUEST, RESPONSE, EXCEPTION, WRITE]
STREAM = b"".join(encode(*frame) for frame in ALL)
IDENTIFICATION = Frame(4, bytes.fromhex("2B 0E 01 00 00 00 02 00 03 61 62 63 01 02 78 79"))
DIAGNOSTICS = Frame(4, bytes.fromhex("08 00 0B 00 00"))
EACH = [encode(*frame) for frame in (*ALL, IDENTIFICATION, DIAGNOSTICS)]


def passed(*chunks: bytes) -> list[Frame]:
    scanner = RtuScanner()
    return [token.frame for chunk in chunks for token in scanner.received(chunk, 0.0)]


def test_requests_and_responses_however_they_are_cut():
    for chunks in chunkings(STREAM):
        assert passed(*chunks) == ALL


def test_with_noise_before_between_and_behind():
    data = b"".join(noise(7, seed=seed) + encode(*frame) for seed, frame in enumerate(ALL)) + b"\x00\x00"
    for seed in range(50):
        assert passed(*random_chunks(data, seed)) == ALL


def test_a_frame_behind_a_beginning_that_never_ends():
    assert passed(bytes.fromhex("01 03 FA") + encode(*EXCEPTION)) == [EXCEPTION]


def looked_at_again(chunks: list[bytes]) -> list[list[Frame]]:
    """What is found with each chunk by looking at everything that may be part of a frame, each time."""
    found, kept = [], b""
    for chunk in chunks:
        data = kept + chunk
        ends = sorted((end, start) for start, end in places(data) if end > len(kept))
        found.append([Frame(data[start], data[start + 1 : end - 2]) for end, start in ends])
        kept = data[1 - MAX_RTU_ADU :]
    return found


def places(data: bytes) -> set[tuple[int, int]]:
    """Where a frame that tells its size begins and ends in `data`."""
    sizes = {
        (start, start + foretell(data[start + 1 : start + 1 + MAX_PDU]) + 3)
        for start in range(len(data) - 1)
        for foretell in (request_size, response_size)
    }
    return {
        (start, end)
        for start, end in sizes
        if 3 < end - start <= min(MAX_RTU_ADU, len(data) - start) and crc_fits(data[start:end])
    }


@pytest.mark.search
@pytest.mark.parametrize("seed", range(6))
def test_whoever_looks_at_each_byte_once_finds_the_same(seed: int):
    """Frames in frames, halves of them and noise; some tell their size bit by bit."""
    dice = random.Random(seed)
    frames = [*EACH, encode(3, bytes((3, len(STREAM))) + STREAM)]
    chunks = []
    for _ in range(500):
        data = dice.choice(frames) + dice.randbytes(dice.choice((0, 0, 1, 9)))
        begin = dice.choice((0, 0, 0, dice.randrange(len(data))))
        chunks += random_chunks(data[begin:], dice.randrange(1000), dice.choice((1, 7, 100)))
    scanner = RtuScanner()
    found = [[token.frame for token in scanner.received(chunk, 0.0)] for chunk in chunks]
    assert found == looked_at_again(chunks)


def test_what_silence_ends_or_is_damaged_or_too_long_is_not_found():
    assert passed(encode(1, b"\x41\x01"), encode(1, bytes.fromhex("03 FF") + bytes(255))) == []
    assert passed(encode(*RESPONSE)[:-1] + b"\x00") == []


def test_little_is_kept():
    scanner = RtuScanner()
    for seed in range(20):
        scanner.received(noise(500, seed), 0.0)
        assert len(scanner._buffer) <= MAX_RTU_ADU
        assert len(scanner._begun) <= 2 * MAX_RTU_ADU
    assert [token.frame for token in scanner.received(encode(*RESPONSE), 0.0)] == [RESPONSE]


def test_a_frame_that_ends_with_a_chunk_may_be_the_beginning_of_another():
    """The address of the request is the check sum of an answer without registers."""
    request = Frame(3, bytes.fromhex("04 00 83 00 02"))
    data = encode(*request)
    assert passed(data[:5], data[5:]) == [Frame(3, b"\4\0"), request]
