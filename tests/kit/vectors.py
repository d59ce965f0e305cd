"""The tables in tests/vectors, read into what tests are parametrized with."""

import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from gateway.modbus.codes import Area
from gateway.modbus.pdu import Span

_FOLDER = Path(__file__).parents[1] / "vectors"

#: Unit and transaction of all frames in exchanges.toml and broken.toml.
UNIT = 17
TRANSACTION = 0x1501


class Wire(NamedTuple):
    """One PDU and its ADU in each framing."""

    pdu: bytes
    rtu: bytes
    ascii: bytes
    tcp: bytes


class Exchange(NamedTuple):
    """A request, what it reads and writes, and a response to it.

    `request_tells_size`: its own first bytes do. `response_tells_size`: the request's or its own first bytes do.
    """

    meaning: str
    request: Wire
    response: Wire
    reads: Span | None
    writes: Span | None
    request_tells_size: bool
    response_tells_size: bool


class Broken(NamedTuple):
    """Bytes that are not the response to QUESTION."""

    meaning: str
    mode: str
    rejected_by: str
    data: bytes


class SeedFrame(NamedTuple):
    """A frame as a manufacturer printed it."""

    meaning: str
    mode: str
    kind: str
    data: bytes


#: What the frames in broken.toml do not answer, and the response that would.
QUESTION = bytes.fromhex("03 00 6B 00 03")
ANSWER = bytes.fromhex("03 06 02 2B 00 00 00 64")


def exchanges() -> list[Exchange]:
    return [
        Exchange(
            row["meaning"],
            _wire(row["request"]),
            _wire(row["response"]),
            _span(row, "reads"),
            _span(row, "writes"),
            "request" not in row.get("silence", ()),
            "response" not in row.get("silence", ()),
        )
        for row in _table("exchanges")["exchange"]
    ]


def broken(mode: str) -> list[Broken]:
    return [
        Broken(row["meaning"], mode, row["rejected_by"], _adu(mode, row["bytes"]))
        for row in _table("broken")["broken"]
        if row["mode"] == mode
    ]


def malformed() -> list[tuple[str, bytes, str]]:
    """Meaning, PDU, and the name of the error that refuses it."""
    return [
        (row["meaning"], bytes.fromhex(row["pdu"]) + bytes(row.get("zeros", 0)), row["error"])
        for row in _table("malformed")["malformed"]
    ]


def seed_frames() -> list[SeedFrame]:
    return [
        SeedFrame(row["meaning"], row["mode"], row["kind"], bytes.fromhex(row["bytes"]))
        for row in _table("seed-frames")["frame"]
    ]


def meaning(vector: Any) -> str:
    """The name of a parametrized test."""
    return vector.meaning


def _table(name: str) -> dict[str, list[dict[str, Any]]]:
    return tomllib.loads((_FOLDER / f"{name}.toml").read_text(encoding="utf-8"))


def _wire(row: dict[str, str]) -> Wire:
    ascii_adu = row["ascii"].encode() + b"\r\n"
    return Wire(bytes.fromhex(row["pdu"]), bytes.fromhex(row["rtu"]), ascii_adu, bytes.fromhex(row["tcp"]))


def _span(row: dict[str, Any], key: str) -> Span | None:
    return Span(Area(row[key][0]), *row[key][1:]) if key in row else None


def _adu(mode: str, text: str) -> bytes:
    return text.encode() if mode == "ascii" else bytes.fromhex(text)


def device_frames(kind: str) -> list[Any]:
    """Read the frames of a kind in device-frames.toml, each as a parameter named by its profile and source."""
    tables = tomllib.loads(_FOLDER.joinpath("device-frames.toml").read_text(encoding="utf-8"))[kind]
    return [pytest.param(table, id=f"{table['profile']}: {table['source']}") for table in tables]
