"""Registers of four bytes behind another server."""

from dataclasses import replace

from gateway.devices.device import Device
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile
from kit.upstream_bench import UpstreamBench


def test_a_read_gets_four_bytes_a_register() -> None:
    bench = UpstreamBench()
    profile = Profile("enron", wide={Area.HOLDING: ((5000, 5999),)})
    device = Device(replace(bench.device(37).settings, profile=profile), bench.upstream)
    for pdu, response in (
        ("03 13 88 00 01", "03 04 00 01 02 03"),
        ("10 13 88 00 01 04 DE AD BE EF", "10 13 88 00 01"),
        ("03 00 00 00 01", "03 02 00 01"),
    ):
        device.submit(bench.client.ask(pdu, unit=37, now=bench.now), bench.now)
        bench.respond("03 02 00 01" if pdu.startswith("03 13") else "03 04 00 01 02 03")
        bench.respond(response)
        assert bench.client.answers[-1] == response
