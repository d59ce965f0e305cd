"""Devices behind a Modbus TCP server: who is asked, and what bounds a client."""

import asyncio

from gateway.simulator.faults import Faults
from gateway.simulator.generic import Generic
from gateway.simulator.server import MOST_CONNECTIONS, MOST_REQUESTS, Connection, SimulatedServer

READ = "0006 {unit:02X} 03 0000 0001"


class Transport(asyncio.Transport):
    """Keeps what is written."""

    def __init__(self):
        super().__init__()
        self.written = b""
        self.is_read = True
        self.is_aborted = False

    def write(self, data):
        self.written += data

    def pause_reading(self):
        self.is_read = False

    def resume_reading(self):
        self.is_read = True

    def abort(self):
        self.is_aborted = True

    def is_closing(self):
        return self.is_aborted


def connected(*devices):
    server = SimulatedServer("127.0.0.1", 0, devices or [Generic(1)])
    connection, transport = Connection(server, asyncio.get_running_loop()), Transport()
    connection.connection_made(transport)
    return connection, transport


def ask(connection, *units, transaction=1):
    data = b"".join(bytes.fromhex(f"{transaction:04X} 0000 {READ.format(unit=unit)}") for unit in units)
    connection.get_buffer(-1)[: len(data)] = data
    connection.buffer_updated(len(data))


async def test_each_unit_responds_with_the_transaction_of_its_request():
    connection, transport = connected(Generic(1), Generic(2))
    ask(connection, 2, transaction=7)
    assert transport.written == b""
    await asyncio.sleep(0.006)
    assert transport.written == bytes.fromhex("0007 0000 0005 02 03 02 0000")


async def test_units_that_are_not_there_and_silent_ones_do_not_respond():
    connection, transport = connected(Generic(1), Generic(2, faults=Faults(silent=True)))
    ask(connection, 0, 2, 3, 255)
    await asyncio.sleep(1)
    assert transport.written == b""


async def test_a_lone_device_also_responds_as_the_server_itself():
    connection, transport = connected(Generic(5))
    ask(connection, 0, 255, 7)
    await asyncio.sleep(1)
    assert [transport.written[at] for at in range(6, len(transport.written), 11)] == [0, 255]


async def test_requests_beyond_those_in_progress_are_read_later():
    connection, transport = connected()
    ask(connection, *(MOST_REQUESTS + 2) * [1])
    assert not transport.is_read
    await asyncio.sleep(0.006)
    assert (len(transport.written) // 11, transport.is_read) == (MOST_REQUESTS, True)
    await asyncio.sleep(0.006)
    assert len(transport.written) // 11 == MOST_REQUESTS + 2


async def test_a_client_that_takes_no_responses_is_not_read():
    connection, transport = connected()
    connection.pause_writing()
    assert not transport.is_read
    ask(connection, 1)
    await asyncio.sleep(1)
    assert transport.written == b""
    connection.resume_writing()
    await asyncio.sleep(1)
    assert (len(transport.written), transport.is_read) == (11, True)


async def test_what_is_no_modbus_ends_the_connection():
    connection, transport = connected()
    connection.get_buffer(-1)[:16] = b"no Modbus at all"
    connection.buffer_updated(16)
    assert transport.is_aborted


async def test_a_response_to_a_client_that_has_gone_is_dropped():
    connection, transport = connected()
    ask(connection, 1)
    transport.abort()
    await asyncio.sleep(1)
    assert transport.written == b""


async def test_there_is_a_limit_to_connections():
    server = SimulatedServer("127.0.0.1", 0, [Generic(1)])
    transports = [Transport() for _ in range(MOST_CONNECTIONS + 1)]
    connections = [Connection(server, asyncio.get_running_loop()) for _ in transports]
    for connection, transport in zip(connections, transports, strict=True):
        connection.connection_made(transport)
    assert [transport.is_aborted for transport in transports] == [False] * MOST_CONNECTIONS + [True]
    connections[0].connection_lost(None)
    assert len(server.connections) == MOST_CONNECTIONS - 1
