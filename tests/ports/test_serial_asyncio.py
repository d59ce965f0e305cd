"""What gateway/ports builds on in the two serial libraries, private members too: a version without one fails here."""

import asyncio
import inspect
from importlib.metadata import version

import pytest
from serial import Serial
from serial_asyncio import SerialTransport


class NoSerial:
    timeout = write_timeout = None

    def fileno(self):
        return 7


class NoLoop:
    """Notes what is to be read, and calls later what is to be called soon."""

    def __init__(self):
        self.soon = []
        self.readers = {}
        self.writers = {}

    def call_soon(self, call, *words):
        self.soon.append((call, words))

    def add_reader(self, descriptor, call):
        self.readers[descriptor] = call

    def remove_reader(self, descriptor):
        del self.readers[descriptor]

    def add_writer(self, descriptor, call):
        self.writers[descriptor] = call

    def remove_writer(self, descriptor):
        del self.writers[descriptor]

    def turn(self):
        called, self.soon = self.soon, []
        for call, words in called:
            call(*words)


@pytest.fixture
def loop():
    return NoLoop()


@pytest.fixture
def transport(loop):
    return SerialTransport(loop, asyncio.Protocol(), NoSerial())


def test_the_version_that_was_read():
    assert version("pyserial-asyncio") == "0.6"


@pytest.mark.parametrize("name", ["_loop", "_closing", "_has_reader", "_write_buffer"])
def test_an_attribute_is_there(transport, name):
    assert name in vars(transport)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("_read_ready", []),
        ("_write_ready", []),
        ("_remove_writer", []),
        ("_close", ["exc"]),
        ("_abort", ["exc"]),
        ("_call_connection_lost", ["exc"]),
    ],
)
def test_a_method_is_there(name, parameters):
    assert list(inspect.signature(getattr(SerialTransport, name)).parameters) == ["self", *parameters]


def test_the_loop_calls_what_was_put_in_the_place_of_its_reader_from_the_next_turn_on(transport, loop):
    """How a compiled function reads without anything between."""
    transport._read_ready = read = object()
    assert (loop.readers, transport._has_reader) == ({}, False)
    loop.turn()
    assert (loop.readers, transport._has_reader) == ({7: read}, True)
    transport.pause_reading()
    assert (loop.readers, transport._has_reader) == ({}, False)


def test_what_is_written_is_kept_until_the_descriptor_takes_it(transport, loop):
    transport.write(b"ask")
    assert (transport._write_buffer, loop.writers) == ([b"ask"], {7: transport._write_ready})


@pytest.mark.parametrize("end", ["close", "_abort"])
def test_it_tells_a_loss_once_nothing_is_watched_any_more(transport, loop, end):
    loop.turn()
    getattr(transport, end)(*([OSError()] if end == "_abort" else []))
    assert (transport._closing, loop.readers, loop.writers) == (True, {}, {})
    [(call, _)] = loop.soon
    assert call == transport._call_connection_lost


@pytest.mark.parametrize("setting", ["timeout", "write_timeout"])
def test_it_still_assigns_timeouts_when_it_takes_a_port_over(transport, setting):
    """Why ConfiguredOnce exists."""
    assert getattr(transport.serial, setting) == 0


def test_pyserial_still_configures_here():
    assert list(inspect.signature(Serial._reconfigure_port).parameters) == ["self", "force_update"]
