"""Each table by itself: its defaults, and what it refuses."""

import pytest
from pydantic import ValidationError

from gateway.config.load import parse
from gateway.config.schema.access import Access
from gateway.config.schema.add_ons import Web
from gateway.config.schema.config import Config, Log
from gateway.config.schema.device import Device
from gateway.config.schema.image import Image, Initial
from gateway.config.schema.line import Line
from gateway.config.schema.listen import Listen
from gateway.config.schema.profile import ProfileTable
from gateway.config.schema.table import Table, row_model
from gateway.config.schema.upstream import Upstream


def tables(model=Config):
    """Every table of the schema."""
    yield model
    for field in model.model_fields.values():
        inner = row_model(field.annotation)
        if inner is not None:
            yield from tables(inner)


@pytest.mark.parametrize("model", sorted(set(tables()), key=lambda model: model.__name__))
def test_every_table_and_every_key_is_described(model):
    assert model.__doc__
    sections = {"listen", "line", "image", "upstream", "profile", "access", "own", "web", "mqtt", "fleet"}
    sections |= {"trace", "control", "log"}
    for name, field in model.model_fields.items():
        assert field.description or (model is Config and name in sections), name


def test_a_line_needs_nothing_but_its_port():
    line = Line.model_validate({"port": "/dev/ttyUSB0"})
    assert (line.mode, line.baud, line.format, line.role, line.rs485) == ("rtu", 19200, None, "client", "adapter")
    assert (line.echo, line.latency, line.profile, line.timeout) == (False, None, "generic", None)
    assert (line.gap, line.turnaround, line.late_window) == (None, None, None)
    assert (line.queue, line.max_wait, line.retries, line.coalesce, line.broadcast) == (64, 2.0, 0, True, True)
    assert (line.devices, line.serves, line.on_failure, line.answer_within) == (None, None, "exception", 1.0)
    assert line.broadcast_to == "images"


def test_the_defaults_of_a_listener():
    listen = Listen.model_validate({"bind": "tcp://0.0.0.0:502"})
    assert (listen.clients, listen.reserve, listen.idle, listen.in_flight, listen.unit0) == (32, 0, 600.0, 16, "refuse")


def test_the_defaults_of_the_other_tables():
    image = Image.model_validate({"unit": 200})
    assert (image.profile, image.persist, image.stale, image.of, image.read) == ("generic", "never", 2.0, None, ())
    profile = ProfileTable.model_validate({})
    assert (profile.idle_chars, profile.margin, profile.timeout, profile.functions) == (3.5, 1.5, 1.0, None)
    upstream = Upstream.model_validate({"to": "tcp://10.1.0.5:502", "units": []})
    assert (upstream.profile, upstream.timeout, upstream.in_flight, upstream.coalesce) == ("generic", None, 16, True)
    assert (upstream.gap, upstream.after_connect, upstream.idle, upstream.wake) == (0.0, 0.0, 0.0, 0.0)
    assert (upstream.retries, upstream.rest, upstream.queue, upstream.max_wait) == (0, None, 64, 2.0)
    assert Access.model_validate({}).units == "all"
    assert (Log().level, Log().format) == ("info", "auto")
    assert Web.model_validate({"bind": "http://127.0.0.1:8502"}).bind.port == 8502


@pytest.mark.parametrize(
    ("model", "raw", "kind"),
    [
        (Line, {}, "missing"),
        (Line, {"port": "/dev/x", "bauds": 9600}, "extra_forbidden"),
        (Line, {"port": "/dev/x", "baud": "9600"}, "int_type"),
        (Line, {"port": "/dev/x", "baud": True}, "int_type"),
        (Line, {"port": "/dev/x", "baud": 0}, "greater_than_equal"),
        (Line, {"port": "/dev/x", "mode": "RTU"}, "literal_error"),
        (Line, {"port": "/dev/x", "echo": "yes"}, "bool_type"),
        (Line, {"port": "/dev/x", "turnaround": "0"}, "value_error"),
        (Line, {"port": "/dev/x", "devices": {"unit": 1}}, "tuple_type"),
        (Line, {"port": "/dev/x", "devices": [1]}, "model_type"),
        (Device, {"unit": 256}, "value_error"),
        (Device, {"unit": 1, "known_as": 2}, "extra_forbidden"),
        (Device, {"unit": 1, "as": 0}, "value_error"),
        (Device, {"unit": 1, "profile": 3}, "string_type"),
        (Image, {"unit": 0}, "value_error"),
        (Image, {"unit": 248}, "value_error"),
        (Image, {"unit": "41"}, "int_type"),
        (Listen, {"bind": "tcp://[::]", "on_failure": "nothing"}, "literal_error"),
        (Line, {"port": "/dev/x", "rest": "0"}, "value_error"),
        (Initial, {"holding": [{"at": 0, "values": [65536]}]}, "value_error"),
        (ProfileTable, {"functions": [0]}, "greater_than_equal"),
        (ProfileTable, {"margin": 0.5}, "greater_than_equal"),
        (ProfileTable, {"idle_chars": 0}, "greater_than"),
        (ProfileTable, {"timing": [{"fc": 3, "items": 0, "time": "1 s"}]}, "greater_than_equal"),
        (Access, {"allow": ["broadcast"]}, "literal_error"),
    ],
)
def test_what_a_table_refuses(model, raw, kind):
    with pytest.raises(ValidationError) as caught:
        model.model_validate(raw)
    assert [found["type"] for found in caught.value.errors()] == [kind]


def test_clients_use_the_units_of_the_wire_unless_as_says_otherwise():
    assert Device.model_validate({"unit": "1-3"}).client_units == (1, 2, 3)
    assert Device.model_validate({"unit": "1-3", "as": "41-43"}).client_units == (41, 42, 43)


@pytest.mark.parametrize(
    ("table", "label"),
    [
        (Line.model_validate({"port": "/dev/serial/by-id/usb-0", "name": "a"}), "a"),
        (Line.model_validate({"port": "/dev/serial/by-id/usb-0"}), "usb-0"),
        (Line.model_validate({"port": "rtu+tcp://10.0.0.1:4001"}), "10.0.0.1:4001"),
        (Listen.model_validate({"bind": "tcp://10.0.0.1:502", "name": "b"}), "b"),
        (Listen.model_validate({"bind": "tcp://10.0.0.1:502"}), "tcp://10.0.0.1:502"),
        (Image.model_validate({"unit": 200, "name": "c"}), "c"),
        (Image.model_validate({"unit": 200}), "image-200"),
        (Upstream.model_validate({"to": "tcp://10.0.0.1:502", "units": [], "name": "d"}), "d"),
        (Upstream.model_validate({"to": "tcp://10.0.0.1:502", "units": []}), "tcp://10.0.0.1:502"),
    ],
)
def test_what_is_named_has_its_name_and_the_rest_is_called_after_its_place(table, label):
    assert table.label == label


def test_a_table_knows_where_it_stands_once_it_was_told():
    table = Table()
    assert (table.path, table.place) == ((), "")
    table.placed(("line", 0), "gateway.toml:3")
    assert (table.path, table.place) == (("line", 0), "gateway.toml:3")


def test_a_table_tells_what_the_user_wrote_from_a_default():
    line = Line.model_validate({"port": "/dev/x", "coalesce": True})
    assert line.has("coalesce")
    assert not line.has("echo")


@pytest.mark.parametrize(
    ("text", "too_short"),
    [
        ('[[listen]]\nbind = "tcp://127.0.0.1:1"\nidle = "{}"\n', "0.5 s"),
        ('[[line]]\nport = "/dev/b"\nrole = "server"\nserves = 1\nanswer_within = "{}"\n', "1 ms"),
        ('[[image]]\nunit = 9\nof = "a/1"\nread = [{{ coils = 1, every = "{}" }}]\n', "0.001 ms"),
        ('[[image]]\nunit = 9\nof = "a/1"\nread = [{{ coils = 1, every = "1 s" }}]\nstale = "{}"\n', "1 ms"),
        ('[[upstream]]\nto = "tcp://b"\nunits = [{{ as = 9, unit = 1 }}]\ntimeout = "{}"\n', "0.1 ms"),
        ('[profile.x]\ntimeout = "{}"\n', "0.1 ms"),
        *((f'latency = "1 ms"\n{key} = "{{}}"\n', "0.1 ms") for key in ("timeout", "max_wait", "late_window")),
    ],
)
def test_times_that_are_too_short_for_anything_are_refused(text, too_short):
    line = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = 1 }]\n'
    said = [str(each) for each in parse(line + text.format(too_short)).problems if each.severity == "error"]
    assert len(said) == 1
    assert "must be at least" in said[0]


def test_a_fast_device_may_take_less_than_a_millisecond():
    assert parse(
        '[profile.x]\ntiming = [{ fc = 3, items = 1, time = "0.3 ms" }]\n[[image]]\nunit = 1\ncoils = 1\n'
    ).config
