"""What the library of NATS raises, in words."""

import pytest
from nats.aio.client import Client
from nats.js import JetStreamContext
from nats.js.errors import ServiceUnavailableError

from gateway.errors import FleetError
from gateway.fleet.connection import NatsConnection
from gateway.fleet.settings import Login, Server


async def test_a_server_without_jetstream_is_named_with_what_mends_it(monkeypatch):
    class Without(JetStreamContext):
        async def stream_info(self, name):
            raise ServiceUnavailableError

    monkeypatch.setattr(Client, "jetstream", lambda self, **_: Without(self))
    with pytest.raises(FleetError, match=r"this NATS server has no JetStream.*start it with --jetstream"):
        await NatsConnection(Server("127.0.0.1", 4222), Login("a")).bucket("mbgw-status")
