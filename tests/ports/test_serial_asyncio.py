"""The private members of the two serial libraries that gateway/ports builds on: a version without one fails here."""

import asyncio
import inspect
from importlib.metadata import version

import pytest
from serial import Serial
from serial_asyncio import SerialTransport


class NoSerial:
    timeout = write_timeout = None


def test_the_version_that_was_read():
    assert version("pyserial-asyncio") == "0.6"


@pytest.mark.parametrize("name", ["_loop", "_closing", "_has_reader", "_write_buffer"])
async def test_an_attribute_is_there(name):
    transport = SerialTransport(asyncio.get_running_loop(), asyncio.Protocol(), NoSerial())
    transport._closing = True  # so that it does not start to read
    assert name in vars(transport)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("_read_ready", []),
        ("_write_ready", []),
        ("_ensure_reader", []),
        ("_remove_reader", []),
        ("_ensure_writer", []),
        ("_remove_writer", []),
        ("_close", ["exc"]),
        ("_abort", ["exc"]),
        ("_call_connection_lost", ["exc"]),
    ],
)
def test_a_method_is_there(name, parameters):
    assert list(inspect.signature(getattr(SerialTransport, name)).parameters) == ["self", *parameters]


@pytest.mark.parametrize("setting", ["timeout", "write_timeout"])
async def test_it_still_assigns_timeouts_when_it_takes_a_port_over(setting):
    """Why ConfiguredOnce exists."""
    serial = NoSerial()
    transport = SerialTransport(asyncio.get_running_loop(), asyncio.Protocol(), serial)
    transport._closing = True
    assert getattr(serial, setting) == 0


def test_pyserial_still_configures_here():
    assert list(inspect.signature(Serial._reconfigure_port).parameters) == ["self", "force_update"]
