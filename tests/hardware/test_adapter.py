"""What the system says of an adapter, on a machine that is built from files."""

import pytest

from gateway.hardware.listing import describe_adapter


@pytest.fixture
def machine(tmp_path):
    for folder in ("dev/serial/by-id", "dev/serial/by-path", "tty"):
        (tmp_path / folder).mkdir(parents=True)
    return tmp_path


def plug(machine, name, place, **files):
    """A terminal `name`, whose hardware is in the folder `place`."""
    (machine / "dev" / name).touch()
    hardware = machine / "hardware" / place
    hardware.mkdir(parents=True)
    for file, text in files.items():
        (hardware / file).write_text(f"{text}\n")
    (machine / "tty" / name).mkdir()
    (machine / "tty" / name / "device").symlink_to(hardware)
    return hardware


def look(machine, port):
    return describe_adapter(str(machine / "dev" / port), machine / "dev", machine / "tty")


def test_an_adapter_on_usb(machine):
    hardware = plug(machine, "ttyUSB0", "usb1/1-1/1-1:1.0/ttyUSB0", latency_timer=16)
    usb = hardware.parents[1]
    for file, text in {"idVendor": "0403", "idProduct": "6001", "product": "FT232R", "serial": "A50285BI"}.items():
        (usb / file).write_text(f"{text}\n")
    (machine / "hardware/ftdi_sio").mkdir()
    (hardware / "driver").symlink_to(machine / "hardware/ftdi_sio")
    link = machine / "dev/serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0"
    link.symlink_to(machine / "dev/ttyUSB0")
    seen = look(machine, "serial/by-id/usb-FTDI_FT232R_A50285BI-if00-port0")
    assert (seen.device, seen.driver, seen.ids) == ("ttyUSB0", "ftdi_sio", "0403:6001")
    assert (seen.usb, seen.latency_timer, seen.links) == ({"product": "FT232R"}, "16", ("serial/by-id",))
    assert seen.has_serial_number
    assert "A50285BI" not in str(seen)


def test_a_port_that_is_built_in(machine):
    plug(machine, "ttyS0", "serial0")
    seen = look(machine, "ttyS0")
    assert (seen.ids, seen.usb, seen.links, seen.latency_timer, seen.has_serial_number) == ("", {}, (), "", False)


def test_a_path_that_leads_nowhere(machine):
    assert (look(machine, "ttyUSB9").device, look(machine, "ttyUSB9").driver) == ("ttyUSB9", "")
