"""What a config means to the parts."""

from ipaddress import ip_network
from textwrap import dedent

import pytest

from gateway.config.load import parse
from gateway.config.plan.settings import DEFAULT_LISTENER, LogSettings, Plan
from gateway.config.resolve import resolve
from gateway.images.image import ImageSettings
from gateway.lines.settings import LineSettings
from gateway.listeners.sessions.server_line import ServerSettings
from gateway.listeners.settings import ListenSettings
from gateway.modbus.codes import Area
from gateway.modbus.pdu import parse_request
from gateway.ports.port import PtySettings, SerialSettings, TcpSettings
from gateway.routing.access import DEFAULT_ROWS, EVERYTHING, NOTHING, READING, WRITING, AccessRow, right_to
from gateway.timing.budget import AnswerTime
from gateway.timing.characters import CharacterFormat, LineTiming
from gateway.upstreams.upstream import UpstreamSettings

LINE = '[[line]]\nname = "a"\nport = "/dev/a"\n'
RTU_8E1 = LineTiming("rtu", 19200, CharacterFormat(8, "E", 1))

#: A request of one register, for functions 3 and 4.
READ_3, READ_4 = parse_request(bytes.fromhex("0300000001")), parse_request(bytes.fromhex("0400000001"))


def plan_of(text):
    loaded = parse(dedent(text), "/etc/modbus-gateway/gateway.toml", port_trouble=lambda _: None, real_path=str)
    assert loaded.config is not None, [str(one) for one in loaded.problems]
    return resolve(loaded.config)


def only_line(text):
    (line,) = plan_of(text).lines
    return line


def test_the_smallest_file_passes_every_unit_through():
    plan = plan_of('[[line]]\nport = "/dev/ttyUSB0"\nbaud = 9600\nformat = "8N1"\n')
    assert plan.listeners == (DEFAULT_LISTENER,)
    assert (DEFAULT_LISTENER.name, DEFAULT_LISTENER.host, DEFAULT_LISTENER.port) == ("default", "127.0.0.1", 5020)
    (line,) = plan.lines
    assert line.passes_through
    assert line.port == SerialSettings("/dev/ttyUSB0", 9600, CharacterFormat(8, "N", 1))
    assert [(device.unit, device.known_as) for device in line.devices] == [(unit, unit) for unit in range(1, 248)]
    assert line.devices[16].name == "ttyUSB0/17"
    assert line.devices[0].source == line.line.source == "gateway.toml:1"


def test_passing_through_leaves_out_the_units_of_images():
    line = only_line(LINE + "[[image]]\nunit = 200\nholding = 1\n")
    assert 200 not in {device.known_as for device in line.devices}
    assert len(line.devices) == 246


def test_all_settings_of_a_line():
    line = only_line(
        """\
        [[line]]
        name = "hall-a"
        port = "/dev/ttyS1"
        baud = 9600
        format = "8N2"
        rs485 = "kernel"
        latency = "3 ms"
        gap = "7 ms"
        turnaround = "150 ms"
        queue = 8
        max_wait = "4 s"
        broadcast = false
        """
    )
    timing = LineTiming("rtu", 9600, CharacterFormat(8, "N", 2))
    assert line.port == SerialSettings("/dev/ttyS1", 9600, timing.format, "kernel", 0.003)
    assert line.latency == 0.003
    assert line.line == LineSettings(
        name="hall-a",
        timing=timing,
        gap=0.007,
        idle_chars=3.5,
        turnaround=0.15,
        queue=8,
        max_wait=4.0,
        broadcast=False,
        source="gateway.toml:1",
    )


def test_the_defaults_of_a_line():
    line = only_line(LINE)
    assert line.line.timing == RTU_8E1
    assert line.line.silence_before_request == RTU_8E1.t35
    assert line.line.frame_end == RTU_8E1.t35
    assert line.line.turnaround == 0.1
    assert (line.line.queue, line.line.max_wait, line.line.broadcast) == (64, 2.0, True)
    assert (line.port.latency, line.latency) == (None, 0.005)


def test_an_ascii_line_waits_for_no_silence():
    line = only_line(LINE + 'mode = "ascii"\n')
    assert line.line.timing == LineTiming("ascii", 19200, CharacterFormat(7, "E", 1))
    assert (line.line.silence_before_request, line.line.frame_end) == (0.0, 0.0)


def test_an_ascii_line_can_have_a_gap():
    line = only_line(LINE + 'mode = "ascii"\ngap = "2 ms"\n')
    assert (line.line.silence_before_request, line.line.frame_end) == (0.002, 0.0)


def test_the_device_that_needs_the_longest_silence_sets_the_gap():
    line = only_line(LINE + 'devices = [{ unit = 1 }, { unit = 2, profile = "v80" }]\n')
    assert line.line.silence_before_request == pytest.approx(RTU_8E1.silence(4.5))
    assert line.line.frame_end == pytest.approx(RTU_8E1.silence(4.5))


def test_no_device_shortens_the_gap_below_that_of_the_specification():
    text = LINE + 'profile = "quick"\n[profile.quick]\nidle_chars = 1\n'
    assert only_line(text).line.silence_before_request == RTU_8E1.t35


def test_without_a_gap_a_frame_still_ends_by_silence():
    line = only_line(LINE + 'gap = "0"\n')
    assert line.line.silence_before_request == 0.0
    assert line.line.frame_end == RTU_8E1.t35


@pytest.mark.parametrize(
    ("devices", "turnaround"),
    [
        ("{ unit = 1 }", 0.1),
        ('{ unit = 1, timeout = "5 s" }', 0.1),
        ('{ unit = 1 }, { unit = 2, profile = "mint" }', 0.75),
    ],
)
def test_after_a_broadcast_the_slowest_table_counts_and_no_plain_time_out(devices, turnaround):
    assert only_line(LINE + f"devices = [{devices}]\n").line.turnaround == pytest.approx(turnaround)


def test_devices_their_units_and_names():
    line = only_line(
        """\
        [[line]]
        name = "hall-a"
        port = "/dev/a"
        devices = [
          { unit = 1, as = 41, name = "silo-1", profile = "weigher" },
          { unit = "10-11", as = "110-111", name = "drive-*" },
          { unit = 7 },
        ]
        """
    )
    assert not line.passes_through
    assert [(d.name, d.unit, d.known_as, d.profile.name, d.source) for d in line.devices] == [
        ("silo-1", 1, 41, "weigher", "gateway.toml:5"),
        ("drive-110", 10, 110, "generic", "gateway.toml:6"),
        ("drive-111", 11, 111, "generic", "gateway.toml:6"),
        ("hall-a/7", 7, 7, "generic", "gateway.toml:7"),
    ]


SLOW = '[profile.slow]\ntiming = [{ fc = 3, items = 1, time = "100 ms" }]\nmargin = 2\ntimeout = "3 s"\n'


@pytest.mark.parametrize(
    ("line", "device", "table_says", "no_row"),
    [
        ("", "", 1.0, 1.0),
        ('timeout = "2 s"', "", 2.0, 2.0),
        ('timeout = "2 s"', 'profile = "generic"', 1.0, 1.0),
        ("", 'profile = "slow"', 0.2, 3.0),
        ('timeout = "2 s"', 'profile = "slow"', 0.2, 3.0),
        ('profile = "slow"', "", 0.2, 3.0),
        ('profile = "slow"\ntimeout = "2 s"', "", 0.2, 2.0),
        ('profile = "slow"\ntimeout = "2 s"', 'timeout = "400 ms"', 0.4, 0.4),
        ("", 'profile = "slow", timeout = "400 ms"', 0.4, 0.4),
    ],
)
def test_who_says_how_long_a_device_may_think(line, device, table_says, no_row):
    """The device's own time-out, else its profile's table, else the line's time-out where it names no profile."""
    devices = f"devices = [{{ unit = 1{', ' * bool(device)}{device} }}]"
    (settings,) = only_line(f"{LINE}{line}\n{devices}\n{SLOW}").devices
    assert settings.answer_time.allowed(READ_3) == pytest.approx(table_says)
    assert settings.answer_time.allowed(READ_4) == pytest.approx(no_row)


def test_a_line_that_passes_through_has_its_own_profile_and_time_out():
    device = only_line(f'{LINE}profile = "slow"\ntimeout = "2 s"\n{SLOW}').devices[0]
    assert device.profile.name == "slow"
    assert device.answer_time == AnswerTime(device.profile.timing, 2.0, 2.0)


def test_all_that_a_profile_says():
    text = """\
    [[line]]
    port = "/dev/a"
    profile = "own"
    [profile.own]
    title = "Own"
    functions = [3, 5]
    limits = { 3 = 20 }
    holding = "1-99"
    coils = 0
    idle_chars = 4.5
    timing = [{ fc = 3, items = 20, time = "60 ms" }, { fc = 3, items = 1, time = "15 ms" }]
    margin = 2
    timeout = "500 ms"
    """
    profile = only_line(text).devices[0].profile
    assert (profile.name, profile.title, profile.functions) == ("own", "Own", frozenset({3, 5}))
    assert profile.limits == {3: 20}
    assert profile.areas == {Area.HOLDING: ((1, 99),), Area.COILS: ()}
    assert (profile.idle_chars, profile.margin, profile.timeout) == (4.5, 2.0, 0.5)
    assert profile.timing.time(3, 1) == 0.015
    assert profile.timing.time(3, 20) == 0.06


def test_listeners():
    plan = plan_of(
        LINE
        + """
[[listen]]
name = "scada"
bind = "tcp://[::1]:1502"
clients = 4
idle = "0"
in_flight = 2
unit0 = "broadcast"
[[listen]]
bind = "tcp://127.0.0.1"
"""
    )
    assert plan.listeners == (
        ListenSettings("scada", "::1", 1502, 4, 0.0, 2, "broadcast", "gateway.toml:5"),
        ListenSettings("tcp://127.0.0.1:502", "127.0.0.1", 502, source="gateway.toml:12"),
    )


def test_what_listeners_speak():
    binds = ("tcp://127.0.0.1:1", "rtu+tcp://127.0.0.1:2", "ascii+tcp://127.0.0.1:3", "udp://127.0.0.1:1")
    text = "".join(f'[[listen]]\nbind = "{bind}"\n' for bind in binds)
    assert [one.scheme for one in plan_of(LINE + text).listeners] == ["tcp", "rtu+tcp", "ascii+tcp", "udp"]


@pytest.mark.parametrize(
    ("other", "ipv6_only"),
    [
        ("tcp://0.0.0.0:502", True),
        ("rtu+tcp://127.0.0.1:502", True),
        ("udp://0.0.0.0:502", False),
        ("tcp://0.0.0.0:503", False),
    ],
)
def test_the_wildcard_of_ipv6_takes_ipv4_clients_unless_somebody_else_does(other, ipv6_only):
    text = f'[[listen]]\nbind = "tcp://[::]:502"\n[[listen]]\nbind = "{other}"\n'
    assert [one.ipv6_only for one in plan_of(LINE + text).listeners] == [ipv6_only, False]
    assert [one.shares_port for one in plan_of(LINE + text).listeners] == [ipv6_only, ipv6_only]


PLC_AND_MORE = LINE + 'devices = [{ unit = 6, profile = "v80" }, { unit = 7, profile = "weigher" }]\n'


def test_all_settings_of_a_server_line():
    plan = plan_of(
        PLC_AND_MORE
        + """\
[[line]]
name = "panel"
port = "/dev/ttyS2"
mode = "ascii"
baud = 9600
format = "7O1"
role = "server"
serves = [6, 7]
gap = "2 ms"
latency = "1 ms"
rs485 = "kernel"
rs485_delay = ["2 ms", "1 ms"]
echo = true
on_failure = "silent"
answer_within = "500 ms"
broadcast_to = "all"
"""
    )
    (server,) = plan.servers
    assert [line.line.name for line in plan.lines] == ["a"]
    assert server.port == SerialSettings("/dev/ttyS2", 9600, CharacterFormat(7, "O", 1), "kernel", 0.001, False, (2, 1))
    assert server.latency == pytest.approx(0.004)
    assert server.line == ServerSettings(
        name="panel",
        timing=LineTiming("ascii", 9600, CharacterFormat(7, "O", 1)),
        serves=frozenset({6, 7}),
        idle_chars=4.5,
        gap=0.002,
        echo=True,
        on_failure="silent",
        answer_within=0.5,
        source="gateway.toml:5",
    )
    assert server.broadcast_to == "all"


def server_line(serves, more=""):
    text = PLC_AND_MORE + '[[image]]\nunit = 9\nprofile = "v80"\ncoils = 1\n'
    (server,) = plan_of(text + f'[[line]]\nport = "/dev/p"\nrole = "server"\nserves = {serves}\n{more}').servers
    return server


def test_the_defaults_of_a_server_line():
    server = server_line(7)
    assert server.line == ServerSettings("p", RTU_8E1, frozenset({7}), source="gateway.toml:9")
    assert server.broadcast_to == "images"
    assert server.line.silence_before_response == RTU_8E1.t35


@pytest.mark.parametrize("serves", [6, "[6, 7]", 9])
def test_a_v80_that_a_server_line_stands_for_is_as_slow_to_answer(serves):
    assert server_line(serves).line.silence_before_response == RTU_8E1.silence(4.5)


@pytest.mark.parametrize(
    ("devices", "functions"),
    [
        ('{ unit = 1, profile = "mint" }', {5, 16}),
        ('{ unit = 1, profile = "mint" }, { unit = 2, profile = "v80" }', {5, 6, 15, 16}),
        ('{ unit = 1, profile = "weigher" }', {16}),
        ("{ unit = 1 }", {5, 6, 15, 16, 22}),
    ],
)
def test_a_line_takes_the_broadcasts_that_one_of_its_devices_knows(devices, functions):
    assert only_line(LINE + f"devices = [{devices}]\n").broadcasts == functions
    assert only_line(LINE + f"devices = [{devices}]\nbroadcast = false\n").broadcasts == set()


def test_images():
    (image,) = plan_of(
        """\
        [[image]]
        unit = 200
        profile = "mint"
        holding = 100
        coils = ["0-3", "8-9"]
        initial.holding = [{ at = 1, values = [7, 8] }]
        """
    ).images
    assert image == ImageSettings(
        unit=200,
        name="image-200",
        profile=image.profile,
        areas={Area.HOLDING: ((0, 99),), Area.COILS: ((0, 3), (8, 9))},
        initial={Area.HOLDING: ((1, (7, 8)),)},
        source="gateway.toml:1",
    )
    assert image.profile.name == "mint"


def test_site_and_log():
    plan = plan_of('site = "plant-2"\n' + LINE + '[log]\nlevel = "debug"\nformat = "json"\n')
    assert plan.site == "plant-2"
    assert plan.log == LogSettings("debug", "json")
    assert plan_of(LINE).log == Plan().log == LogSettings("info", "auto")


def test_a_device_server_as_the_port_of_a_line():
    line = only_line('[[line]]\nport = "ascii+tcp://[fe80::1]:4001"\nbaud = 9600\n')
    assert line.port == TcpSettings("ascii+tcp://[fe80::1]:4001", "fe80::1", 4001, latency=0.1)
    assert line.line.timing == LineTiming("ascii", 9600, CharacterFormat(7, "E", 1))
    assert line.line.name == "[fe80::1]:4001"
    assert only_line('[[line]]\nport = "rtu+tcp://x:1"\nlatency = "30 ms"\n').latency == 0.03


def test_all_settings_of_an_upstream():
    (upstream,) = plan_of(
        """\
        [[upstream]]
        name = "plant-1"
        to = "tcp://10.1.0.5"
        units = [{ as = "37-38", unit = [0, 255] }]
        timeout = "300 ms"
        in_flight = 4
        """
    ).upstreams
    assert upstream.port == TcpSettings("tcp://10.1.0.5:502", "10.1.0.5", 502, latency=0.0)
    assert upstream.upstream == UpstreamSettings("plant-1", in_flight=4, source="gateway.toml:1")
    assert [(one.name, one.unit, one.known_as) for one in upstream.devices] == [
        ("plant-1/37", 0, 37),
        ("plant-1/38", 255, 38),
    ]


def test_passing_through_leaves_out_the_units_of_upstreams():
    line = only_line(LINE + '[[upstream]]\nto = "tcp://10.1.0.5"\nunits = [{ as = "37-38", unit = "1-2" }]\n')
    assert not {37, 38} & {device.known_as for device in line.devices}
    assert len(line.devices) == 245


# Rights


def test_rights():
    rows = """\
        [[access]]
        from   = ["10.2.0.0/24"]
        listen = ["default"]
        units  = ["1-2", 7]
        allow  = ["read", "write"]

        [[access]]
        functions = [3, 16]
        """
    assert plan_of(LINE + dedent(rows)).access == (
        AccessRow(
            EVERYTHING, (ip_network("10.2.0.0/24"),), frozenset(["default"]), frozenset([1, 2, 7]), "gateway.toml:4"
        ),
        AccessRow(right_to([3, 16]), source="gateway.toml:10"),
    )


@pytest.mark.parametrize(
    ("allow", "right"),
    [
        ([], NOTHING),
        (["read"], READING),
        (["write"], WRITING),
        (["write", "read"], EVERYTHING),
    ],
)
def test_what_is_allowed(allow, right):
    (row,) = plan_of(LINE + f"[[access]]\nallow = {allow}\n").access
    assert row.right == right


def test_nobody_has_written_rights():
    assert plan_of(LINE).access == DEFAULT_ROWS


def test_a_listener_for_one_line_and_what_it_says_of_failures():
    text = '[[listen]]\nname = "x"\nbind = "tcp://[::1]:1502"\nline = "a"\non_failure = "silent"\n' + LINE
    (listener,) = plan_of(text).listeners
    assert listener == ListenSettings("x", "::1", 1502, line="a", on_failure="silent")


@pytest.mark.parametrize(
    ("text", "rest"), [("", None), ('rest = "auto"', None), ('rest = "off"', 0.0), ('rest = "5 s"', 5.0)]
)
def test_the_longest_rest(text, rest):
    assert only_line(LINE + text).line.rest == rest


OWN = '[[listen]]\nbind = "tcp://[::1]:1502"\nline = "a"\n'
OTHER = '[[line]]\nname = "b"\nport = "/dev/b"\ndevices = [{ unit = 7 }]\n'


@pytest.mark.parametrize(
    ("text", "addresses", "shared"),
    [
        (LINE, 246, 246),
        (OWN + LINE, 247, 246),
        (OWN + LINE + OTHER, 247, 0),
        (OWN + LINE + 'devices = [{ unit = 0, as = 5 }, { unit = "1-3", as = "11-13" }]\n', 3, 4),
    ],
)
def test_who_leads_to_a_line(text, addresses, shared):
    line = plan_of(text + "[[image]]\nunit = 200\nholding = 1\n").lines[0]
    assert (len(line.addresses), len(line.shared)) == (addresses, shared)
    assert line.line.name == "a"


def test_a_line_that_gets_a_listener_of_its_own_means_the_same():
    without, own = (only_line(text + LINE + "[[image]]\nunit = 200\nholding = 1\n") for text in ("", OWN))
    assert without != own
    assert without.meaning == own.meaning


def test_a_virtual_port_is_named_after_its_link():
    (server,) = plan_of(LINE + '[[line]]\nport = "pty:ttyHMI"\nrole = "server"\nserves = "all"\n').servers
    assert server.line.name == "ttyHMI"
    assert server.port == PtySettings("pty:ttyHMI", "ttyHMI", "dialout", 0.005)
    assert server.line.timing == LineTiming("rtu", 19200, CharacterFormat(8, "N", 1))
    text = '[[line]]\nport = "pty:/run/x/com1"\ngroup = "users"\nlatency = "1 ms"\nrole = "server"\nserves = "all"\n'
    (server,) = plan_of(LINE + text).servers
    assert server.line.name == "com1"
    assert server.port == PtySettings("pty:/run/x/com1", "/run/x/com1", "users", 0.001)


def test_a_server_line_for_all_serves_what_a_listener_leads_to():
    text = """
        [[line]]
        name = "a"
        port = "/dev/a"
        devices = [{ unit = 1, as = 41, name = "x" }, { unit = 250 }, { unit = 3, as = "none", name = "unnumbered" }]
        [[upstream]]
        to = "tcp://10.0.0.1"
        units = [{ unit = 7, as = 77 }]
        [[image]]
        unit = 200
        holding = 1
        [[image]]
        unit = 201
        of = "x"
        read = [{ holding = "0-9", every = "1 s" }]
        [[image]]
        unit = 202
        stale = "5 s"
        map = [{ at = 0, device = "x", holding = 0, every = "1 s" }]
        [self]
        unit = 255
        [[line]]
        name = "panel"
        port = "/dev/p"
        role = "server"
        serves = "all"
        """
    (server,) = plan_of(text).servers
    assert server.serves_all
    assert server.line.serves == {41, 250, 77, 200, 201, 202, 255}


def test_a_server_line_for_all_serves_units_that_pass_through():
    assert server_line('"all"').line.serves
    text = '[[line]]\nport = "/dev/a"\n[[line]]\nname = "p"\nport = "/dev/p"\nrole = "server"\nserves = "all"\n'
    (server,) = plan_of(text).servers
    assert server.line.serves == frozenset(range(1, 248))


def test_a_file_that_says_that_there_is_no_listener_has_not_the_default_one():
    image = "[[image]]\nunit = 1\nholding = 1\n"
    assert [listener.port for listener in plan_of(image).listeners] == [5020]
    assert plan_of(f"listen = []\n{image}").listeners == ()


def test_units_of_a_file_without_listeners_are_for_other_ways_in():
    loaded = parse("listen = []\n[[image]]\nunit = 1\nholding = 1\n")
    assert [str(problem) for problem in loaded.problems] == []
