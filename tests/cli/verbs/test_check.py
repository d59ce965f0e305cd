"""`check`: what is wrong with a config file, and what it means."""

import json
import re
from functools import partial
from pathlib import Path
from textwrap import dedent

import pytest

from gateway.cli.main import main
from gateway.cli.show.devices import round_up
from gateway.readconfig.file_troubles import with_file_troubles
from kit.pty import VirtualPort

FILE = """\
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:1502"
idle = "0"
[[listen]]
name = "six"
bind = "tcp://[::1]:1502"
unit0 = 41

[[line]]
name = "hall-a"
port = "/dev/null"
latency = "5 ms"
devices = [
  { unit = 1, as = 41, name = "silo-1", profile = "weigher" },
  { unit = "10-11", as = "110-111", name = "drive-*", timeout = "400 ms" },
]

[[image]]
unit = 200
name = "shift-data"
holding = 100
coils = ["0-7", "16-23"]
"""


@pytest.fixture
def config(tmp_path):
    """Writes a config file and gives its path."""

    def write(text):
        path = tmp_path / "gateway.toml"
        path.write_text(dedent(text), encoding="utf-8")
        return str(path)

    return write


def test_the_picture_of_a_file(config, capsys):
    assert main(["check", config(FILE)]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        Listeners
          NAME   ADDRESS               CLIENTS  IDLE    UNIT 0  LEADS TO
          scada  tcp://127.0.0.1:1502  32       never   refuse  all units
          six    tcp://[::1]:1502      32       10 min  41      all units

        Rights: first match wins
          FROM             THROUGH       UNITS  RIGHTS
          this machine     any listener  all    read, write
          anywhere         any listener  all    read
          who may open it  control       all    read, write

        Line hall-a: /dev/null
          rtu 19200 8E1, gap 2.01 ms, latency 5 ms, wire serial
          UNIT  ON THE WIRE  DEVICE     PROFILE  LONGEST WAIT
          41    1            silo-1     weigher  3.16 s
          110   10           drive-110  generic  2.71 s
          111   11           drive-111  generic  2.71 s
          Time limits of weigher, unit 41
            FUNCTION  LIMIT FOR 1 ITEM  MOST ITEMS  LIMIT FOR MOST
            3         1.01 s            125         1.15 s
            16        1.01 s            123         1.01 s
          Reads at most, of weigher, unit 41
            (its profile has no answer times: as if it answered at once)
            HOLDING  LINE TIME  READS/S ALONE  READS/S WITH ALL IN TURN
            1        17.6 ms    56.8           18.9
            10       27.9 ms    35.8           11.9
            125      159.7 ms   6.3            2.1
          Time limits of generic, units 110-111
            FUNCTION  LIMIT FOR 1 ITEM  MOST ITEMS  LIMIT FOR MOST
            1         408 ms            2000        551 ms
            2         408 ms            2000        551 ms
            3         409 ms            125         551 ms
            4         409 ms            125         551 ms
            5         410 ms            1           410 ms
            6         410 ms            1           410 ms
            15        410 ms            1968        410 ms
            16        410 ms            123         410 ms
            22        411 ms            1           411 ms
            23        409 ms            125         551 ms
            others    552 ms            -           552 ms
          Reads at most, of generic, units 110-111
            (its profile has no answer times: as if it answered at once)
            HOLDING  LINE TIME  READS/S ALONE  READS/S WITH ALL IN TURN
            1        17.6 ms    56.8           18.9
            10       27.9 ms    35.8           11.9
            125      159.7 ms   6.3            2.1

        Images
          UNIT  NAME        PROFILE  KEPT   ADDRESSES
          200   shift-data  generic  never  coils 0-7, 16-23; holding 0-99

        Longest wait = max_wait + gap + longest request on the wire + its time limit.
        Set each client's time-out above the longest wait of the units that it polls.
        The longest wait is valid for up to in_flight requests at once per connection;
        further requests are read later.

        no errors, no warnings
        """
    )


def test_a_line_that_passes_through_is_one_row(config, capsys):
    assert main(["check", config('[[line]]\nname = "a"\nport = "/dev/null"\n')]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "  1-247  same         (each)  generic  3.31 s" in said
    assert "  Time limits of generic, units 1-247" in said
    assert "  rtu 19200 8E1, gap 2.01 ms, latency 5 ms (USB: up to 20 ms), wire serial" in said


MIRROR = """
[[image]]
unit = 241
of = "silo-1"
stale = "10 s"
read = [{ holding = "0-9", every = "EVERY" }, { holding = "16-16", every = "2 s" }]
"""


def test_the_share_of_a_line_that_polls_take_is_shown(config, capsys):
    assert main(["check", config(FILE + MIRROR.replace("EVERY", "500 ms"))]) == 0
    said = capsys.readouterr().out
    assert "  Declared polls take at least 6.5 % of the line (answer times not known: weigher)\n" in said
    assert " BY OF READS EVERY LINE TIME SHARE mirror image-241 silo-1 holding 0-9 500 ms 27.9 ms 5.6 % " in " ".join(
        said.split()
    )
    assert "warning" not in said.replace("no warnings", "")


def test_polls_that_need_all_of_a_line_are_a_warning(config, capsys):
    assert main(["check", config(FILE + MIRROR.replace("EVERY", "30 ms"))]) == 0
    said = capsys.readouterr().out
    assert 'warning: line[0]: the polls of mirrors need at least 94% of its time (line "hall-a")\n' in said
    assert "  help: poll less often, or raise the rate of the line\n" in said


def test_polls_and_their_shares_as_json(config, capsys):
    main(["check", "--json", config(FILE + MIRROR.replace("EVERY", "500 ms"))])
    (line,) = json.loads(capsys.readouterr().out)["lines"]
    assert line["polls"][0] == {
        "by": ["mirror image-241"],
        "of": "silo-1",
        "addresses": "holding 0-9",
        "wanted": 1,
        "bridged": 0,
        "every_ms": 500.0,
        "line_time_ms": 27.917,
        "share": 0.0558,
        "answer_time_known": False,
    }
    assert line["polls_share"] == pytest.approx(sum(poll["share"] for poll in line["polls"]), abs=1e-4)


BRIDGING = """
site = "plant"
[[line]]
name = "hall"
port = "/dev/null"
latency = "5 ms"
devices = [
  { unit = 1, as = 41, name = "meter", profile = "meter" },
  { unit = 2, as = 42, name = "other", profile = "meter" },
]

[profile.meter]
timeout = "1 s"
max_gap = GAP
points = [
  { name = "a", holding = 0 },
  { name = "b", holding = 4 },
  { name = "c", holding = 9 },
  { name = "d", coils = 1 },
]

[[image]]
unit = 241
of = "other"
stale = "10 s"
read = [{ holding = ["0-1", "4-5"], every = "1 s" }]

[mqtt]
broker = "mqtt://broker"
publish = [{ device = "meter", every = "1 s" }]
"""


def test_how_few_requests_read_the_points_over_gaps_is_told(config, capsys):
    bridged = "    3 requests for 4 points and 2 ranges, over 9 addresses between them (max_gap)\n"
    for gap, is_told in (("0", False), ("4", True)):
        main(["check", config(BRIDGING.replace("GAP", gap))])
        said = capsys.readouterr().out
        assert (f" (answer times not known: meter)\n{bridged}    BY" in said) is is_told
        assert ("max_gap" in said) is is_told
    main(["check", "--json", config(BRIDGING.replace("GAP", "4"))])
    polls = json.loads(capsys.readouterr().out)["lines"][0]["polls"]
    assert [(each["addresses"], each["wanted"], each["bridged"]) for each in polls] == [
        ("coils 1", 1, 0),
        ("holding 0-9", 3, 7),
        ("holding 0-5", 2, 2),
    ]


def test_polls_of_one_device_are_counted_once_and_name_all_who_want_them(config, capsys):
    shared = BRIDGING.replace("GAP", "4").replace('of = "other"', 'of = "meter"\nname = "copy"')
    shared = shared.replace('["0-1", "4-5"], every', '["4", "6-9"], every')
    main(["check", config(shared)])
    said = capsys.readouterr().out
    assert "    2 requests for 4 points and 2 ranges, over 4 addresses between them (max_gap)\n" in said
    assert " ".join(said.split()).count(" mqtt, mirror copy meter holding 0-9 1 s ") == 1
    main(["check", "--json", config(shared.replace('"1 s" }]\n\n[mqtt]', '"2 s" }]\n\n[mqtt]'))])
    polls = json.loads(capsys.readouterr().out)["lines"][0]["polls"]
    assert [(each["by"], each["addresses"], each["every_ms"]) for each in polls] == [
        (["mqtt"], "coils 1", 1000.0),
        (["mqtt"], "holding 0-9", 1000.0),
        (["mirror copy"], "holding 4-9", 2000.0),
    ]


OWN = """\
[[listen]]
name = "a"
bind = "tcp://127.0.0.1:1503"
line = "hall-a"
[[listen]]
name = "b"
bind = "udp://127.0.0.1:1503"
line = "yard"
on_failure = "silent"
[[line]]
name = "yard"
port = "/dev/zero"
"""


def test_listeners_for_one_line_say_where_they_lead(config, capsys):
    assert main(["check", config(OWN + FILE)]) == 0
    said = capsys.readouterr().out
    assert "  a      tcp://127.0.0.1:1503  32       10 min  refuse  line hall-a\n" in said
    assert '  Through "a": 1, 10-11, as on the wire.\n' in said
    assert '  Through "b" and no other listener: 1-247, as on the wire.\n' in said


WITHOUT_UNITS = """
[[listen]]
name = "a"
bind = "tcp://127.0.0.1:1502"
line = "x"

[[line]]
name = "x"
port = "/dev/null"
devices = [{ unit = "1-5", as = "none", name = "meter-*" }]
"""


def test_devices_without_units_are_shown_by_their_names(config, capsys):
    main(["check", config(WITHOUT_UNITS)])
    said = capsys.readouterr().out
    assert "  UNIT  ON THE WIRE  DEVICE   PROFILE  LONGEST WAIT\n  -     1            meter-1  generic" in said
    assert '  Through "a" and no other listener: 1-5, as on the wire.\n' in said
    assert "  Time limits of generic, meter-1, meter-2, meter-3, ...\n" in said
    main(["check", "--json", config(WITHOUT_UNITS)])
    units = json.loads(capsys.readouterr().out)["lines"][0]["units"]
    assert [(each["unit"], each["device"], each["on_the_wire"]) for each in units[:2]] == [
        (None, "meter-1", "1"),
        (None, "meter-2", "2"),
    ]


def test_listeners_for_one_line_as_json(config, capsys):
    main(["check", "--json", config(OWN + FILE)])
    picture = json.loads(capsys.readouterr().out)
    assert [(one["line"], one["on_failure"]) for one in picture["listeners"]] == [
        ("hall-a", "exception"),
        ("yard", "silent"),
        (None, "exception"),
        (None, "exception"),
    ]
    assert [(one["own_listeners"], one["shared"], one["addresses"]) for one in picture["lines"]] == [
        (["b"], False, "1-247"),
        (["a"], True, "1, 10-11"),
    ]


def test_what_images_answer_does_not_pass_through(config, capsys):
    main(["check", config('[[line]]\nport = "/dev/null"\n[[image]]\nunit = 200\ncoils = 1\n')])
    assert "  1-199, 201-247  same" in capsys.readouterr().out


def test_an_ascii_line_has_no_gap(config, capsys):
    main(["check", config('[[line]]\nport = "/dev/null"\nmode = "ascii"\n')])
    assert "  ascii 19200 7E1, gap none," in capsys.readouterr().out


@pytest.mark.parametrize(("wire", "shown"), [("auto", "direct"), ("serial", "serial")])
def test_what_the_wire_of_a_virtual_port_is(wire, shown, config, tmp_path, capsys):
    with VirtualPort(tmp_path / "port") as virtual:
        assert main(["check", config(f'[[line]]\nport = "{virtual.path}"\nwire = "{wire}"\n')]) == 0
    assert f", wire {shown}\n" in capsys.readouterr().out


def test_what_auto_is_cannot_be_seen_before_there_is_a_port(config, capsys):
    main(["check", config('[[line]]\nport = "/dev/absent"\n')])
    assert ", wire auto\n" in capsys.readouterr().out


def test_a_file_without_lines_has_no_waits(config, capsys):
    assert main(["check", config("[[image]]\nunit = 200\ncoils = 1\n")]) == 0
    said = capsys.readouterr().out
    assert "Line" not in said
    assert "time-out" not in said


def test_a_line_is_no_wider_than_a_terminal(config, capsys):
    main(["check", config(FILE)])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


def test_errors_are_all_that_is_shown_and_make_the_status_1(config, capsys):
    path = config('[[line]]\nport = "/dev/null"\nbaud = "9600"\nmode = "RTU"\n')
    assert main(["check", path]) == 1
    assert capsys.readouterr().out == (
        f"{path}:3:8: error: line[0].baud: must be a whole number\n"
        '    3 | baud = "9600"\n'
        "      |        ^\n"
        "  help: write it without quotes: baud = 9600\n"
        f'{path}:4:8: error: line[0].mode: must be "rtu" or "ascii"\n'
        '    4 | mode = "RTU"\n'
        "      |        ^\n"
        '  help: did you mean "rtu"?\n'
        "2 errors, no warnings\n"
    )


def test_warnings_leave_the_status_0(config, capsys):
    path = config('[[line]]\nport = "/dev/null/absent"\n')
    assert main(["check", path]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{path}:2:8: warning: line[0].port: there is no such port at the moment")
    assert said.endswith("\n\nno errors, 1 warning\n")


def test_two_lines_without_a_port_have_one_help(config, capsys):
    lines = (f'[[line]]\nport = "/dev/null/{unit}"\ndevices = [{{ unit = {unit} }}]\n' for unit in (1, 2))
    path = config("".join(lines))
    assert main(["check", path]) == 0
    said = capsys.readouterr().out
    assert said.count("there is no such port at the moment") == 2
    assert said.count("the line waits for it") == 1


def test_a_file_that_does_not_exist_is_one_problem(tmp_path, capsys):
    path = tmp_path / "absent.toml"
    assert main(["check", str(path)]) == 1
    help_ = "create it, or name another file; `modbus-gateway` alone prints one to begin with"
    said = f"{path}: error: there is no such file\n  help: {help_}\n1 error, no warnings\n"
    assert capsys.readouterr().out == said
    assert main(["check", "--json", str(path)]) == 1
    (problem,) = json.loads(capsys.readouterr().out)["problems"]
    assert (problem["line"], problem["column"]) == (None, None)


def test_the_picture_as_json(config, capsys):
    assert main(["check", "--json", config(FILE)]) == 0
    picture = json.loads(capsys.readouterr().out)
    assert picture["problems"] == []
    assert picture["listeners"][1] == {
        "name": "six",
        "address": "tcp://[::1]:1502",
        "clients": 32,
        "reserve": 0,
        "idle_ms": 600000.0,
        "in_flight": 16,
        "unit0": 41,
        "on_failure": "exception",
        "line": None,
        "upstream": None,
    }
    (line,) = picture["lines"]
    unit = line["units"][0]
    limits, reads = unit.pop("limits"), unit.pop("reads")
    assert line.pop("units")[0] is unit
    assert line == {
        "name": "hall-a",
        "port": "/dev/null",
        "mode": "rtu",
        "baud": 19200,
        "format": "8E1",
        "gap_ms": 2.005,
        "turnaround_ms": 100.0,
        "latency_ms": 5.0,
        "wire": "serial",
        "retries": 0,
        "retry_within_ms": None,
        "rest_ms": None,
        "passes_through": False,
        "shared": True,
        "own_listeners": [],
        "addresses": "1, 10-11",
        "polls": [],
        "polls_share": 0,
    }
    assert reads[0] == {
        "area": "holding",
        "items": 1,
        "line_time_ms": 17.604,
        "per_second": 56.805,
        "per_second_in_turn": 18.935,
        "answer_time_known": False,
    }
    assert unit == {
        "unit": "41",
        "on_the_wire": "1",
        "device": "silo-1",
        "profile": "weigher",
        "longest_wait_ms": 3157.682,
        "written_through": [],
    }
    assert limits[0] == {"function": 3, "one_item_ms": 1009.01, "most_items": 125, "most_items_ms": 1151.094}
    assert picture["images"] == [
        {
            "unit": 200,
            "name": "shift-data",
            "profile": "generic",
            "persist": "never",
            "areas": {"coils": [[0, 7], [16, 23]], "holding": [[0, 99]]},
        }
    ]


def test_reads_of_a_device_without_a_wire_take_no_time_that_is_known(config, capsys):
    file = config('[[line]]\nport = "/dev/null"\nmode = "ascii"\nwire = "direct"\ndevices = [{ unit = 1 }]')
    assert main(["check", "--json", file]) == 0
    reads = json.loads(capsys.readouterr().out)["lines"][0]["units"][0]["reads"]
    rates = {(one["line_time_ms"], one["per_second"], one["per_second_in_turn"]) for one in reads}
    assert rates == {(0.0, None, None)}
    assert main(["check", file]) == 0
    assert "0.0 ms     -              -" in capsys.readouterr().out


SERVED = (
    FILE
    + """
[[line]]
name = "panel"
port = "/dev/zero"
mode = "ascii"
latency = "5 ms"
role = "server"
serves = [41, 200]
"""
)


def test_a_server_line_shows_what_its_client_must_be_set_to(config, capsys):
    assert main(["check", config(SERVED)]) == 0
    assert (
        dedent(
            """\
        Server line panel: /dev/zero
          ascii 19200 7E1, silence before a response none, wire serial
          UNIT  ANSWERED BY  LONGEST WAIT
          41    silo-1       3.16 s
          200   shift-data   at once
          A response that takes longer than 1 s is not sent.
          Broadcasts go to: images.
          Set the time-out of the client on this line above 1.38 s.
        """
        )
        in capsys.readouterr().out
    )


def test_a_server_line_as_json(config, capsys):
    assert main(["check", "--json", config(SERVED)]) == 0
    assert json.loads(capsys.readouterr().out)["servers"] == [
        {
            "name": "panel",
            "port": "/dev/zero",
            "mode": "ascii",
            "baud": 19200,
            "format": "7E1",
            "silence_before_response_ms": 0.0,
            "wire": "serial",
            "on_failure": "exception",
            "answer_within_ms": 1000.0,
            "broadcast_to": "images",
            "longest_wait_ms": 1372.188,
            "units": [
                {"unit": 41, "answered_by": "silo-1", "longest_wait_ms": 3157.682},
                {"unit": 200, "answered_by": "shift-data", "longest_wait_ms": 0.0},
            ],
        }
    ]


def test_problems_as_json(config, capsys):
    path = config('[[line]]\nport = "/dev/null"\nbuad = 9600\n')
    assert main(["check", "--json", path]) == 1
    assert json.loads(capsys.readouterr().out) == {
        "problems": [
            {
                "severity": "error",
                "file": path,
                "line": 3,
                "column": 1,
                "path": "line[0].buad",
                "what": "unknown key",
                "help": 'did you mean "baud"?',
            }
        ]
    }


UPSTREAM = """\
[[line]]
name = "roof"
port = "rtu+tcp://10.1.0.9:4001"
devices = [{ unit = 1, profile = "weigher" }]

[[upstream]]
name = "plant-1"
to = "tcp://10.1.0.5"
units = [{ as = "37-38", unit = "7-8" }]
timeout = "300 ms"
"""


def test_units_behind_servers(config, capsys):
    assert main(["check", config(UPSTREAM)]) == 0
    said = capsys.readouterr().out
    assert "Line roof: rtu+tcp://10.1.0.9:4001\n  rtu 19200 8E1, gap 2.01 ms, latency 100 ms, wire direct\n" in said
    assert (
        dedent(
            """\
            Upstream plant-1: tcp://10.1.0.5:502
              16 in flight
              UNIT  BEHIND THE SERVER  DEVICE      PROFILE  LONGEST WAIT
              37    7                  plant-1/37  generic  2.3 s
              38    8                  plant-1/38  generic  2.3 s
              Time limit of generic, units 37-38: 300 ms

            """
        )
        in said
    )
    assert "time-out above the longest wait" in said


PORT_OF_PLANT_1 = '[[listen]]\nname = "{}"\nbind = "tcp://127.0.0.1:1503"\nupstream = "plant-1"\n'


def test_listeners_for_one_upstream_say_where_they_lead(config, capsys):
    assert main(["check", config(PORT_OF_PLANT_1.format("p") + UPSTREAM)]) == 0
    said = capsys.readouterr().out
    assert "  p     tcp://127.0.0.1:1503  32       10 min  0       upstream plant-1\n" in said
    assert 'plant-1/38  generic  2.3 s\n  Through "p": 0-255, as behind the server; longest wait 2.3 s.\n' in said
    without = UPSTREAM.replace('units = [{ as = "37-38", unit = "7-8" }]\n', "")
    assert main(["check", config(PORT_OF_PLANT_1.format("p") + without)]) == 0
    said = capsys.readouterr().out
    assert '16 in flight\n  Through "p" and no other listener: 0-255, as behind the server; longest' in said


def test_listeners_for_one_upstream_as_json(config, capsys):
    main(["check", "--json", config(PORT_OF_PLANT_1.format("p") + UPSTREAM)])
    picture = json.loads(capsys.readouterr().out)
    assert [(one["line"], one["upstream"], one["unit0"]) for one in picture["listeners"]] == [(None, "plant-1", 0)]
    assert [one["own_listeners"] for one in picture["upstreams"]] == [["p"]]


def test_units_behind_servers_as_json(config, capsys):
    main(["check", "--json", config(UPSTREAM)])
    picture = json.loads(capsys.readouterr().out)
    assert picture["lines"][0]["latency_ms"] == 100
    (upstream,) = picture["upstreams"]
    units = upstream.pop("units")
    assert upstream == {
        "name": "plant-1",
        "to": "tcp://10.1.0.5:502",
        "others": [],
        "in_flight": 16,
        "gap_ms": 0,
        "after_connect_ms": 0,
        "idle_ms": 0,
        "transaction_id": "checked",
        "coalesce": True,
        "retries": 0,
        "rest_ms": None,
        "own_listeners": [],
        "longest_wait_ms": 2300,
        "polls": [],
        "polls_share": 0,
    }
    assert [(one["unit"], one["behind_the_server"], one["device"], one["profile"]) for one in units] == [
        ("37", "7", "plant-1/37", "generic"),
        ("38", "8", "plant-1/38", "generic"),
    ]
    assert {(one["longest_wait_ms"], one["wake_ms"]) for one in units} == {(2300, 0)}
    assert {row["most_items_ms"] for one in units for row in one["limits"]} == {300}


INVERTER = """\
[[upstream]]
name = "roof"
to = ["tcp://10.1.0.5", "tcp://10.2.0.5"]
gap = "50 ms"
after_connect = "100 ms"
idle = "30 s"
coalesce = false
retries = 1
rest = "off"
transaction_id = "zero"
units = [
  { unit = 1, as = 37, name = "inverter", profile = "inverter", wake = "5 min" },
  { unit = 2, as = 38, name = "meter" },
]
[profile.inverter]
functions = [3]
holding = "0-9"
timing = [{ fc = 3, items = 1, time = "10 ms" }, { fc = 3, items = 10, time = "100 ms" }]
[[image]]
unit = 241
of = "inverter"
stale = "10 s"
read = [{ holding = "0-9", every = "EVERY" }]
"""


def test_a_device_behind_a_server_is_shown_as_one_on_a_line_and_so_are_the_manners_of_the_server(config, capsys):
    assert main(["check", config(INVERTER.replace("EVERY", "1 s"))]) == 0
    # 2 s in the queue, the gap, the silence after connecting, and 1.5 x 100 ms + 100 ms of the network; then twice (to
    # wake it, and to repeat it) the gap, a new connection, and that limit
    assert (
        dedent(
            """\
        Upstream roof: tcp://10.1.0.5:502, else tcp://10.2.0.5:502
          1 in flight, gap 50 ms, 100 ms of silence after connecting, closed after 30 s without a request
          responses with transaction identifier 0 are taken too
          equal reads do not share a transaction
          retries 1
          rest off
          UNIT  BEHIND THE SERVER  DEVICE    PROFILE   LONGEST WAIT  WRITTEN THROUGH, TOO
          37    1                  inverter  inverter  3.7 s         241 image-241
          38    2                  meter     generic   5.31 s
          inverter sleeps: after 5 min without a request its first read is sent twice.
          Declared polls take 15.0 % of the connection
            BY                OF        READS        EVERY  TIME      SHARE
            mirror image-241  inverter  holding 0-9  1 s    150.0 ms  15.0 %
          Time limits of inverter, unit 37
            FUNCTION  LIMIT FOR 1 ITEM  MOST ITEMS  LIMIT FOR MOST
            3         115 ms            10          250 ms
          Time limit of generic, unit 38: 1 s

        """
        )
        in capsys.readouterr().out
    )


def test_what_the_longest_wait_is_made_of_is_said_of_what_there_is(config, capsys):
    main(["check", config(INVERTER.replace("EVERY", "1 s"))])
    said = capsys.readouterr().out
    assert "Behind an upstream it is max_wait + gap + after_connect" in said
    assert "Longest wait = " not in said


def test_several_requests_at_once_share_the_time_of_a_connection(config, capsys):
    text = (
        INVERTER.replace("EVERY", "1 s")
        .replace('gap = "50 ms"', "in_flight = 4")
        .replace('transaction_id = "zero"', "")
    )
    assert main(["check", config(text)]) == 0
    assert "  Declared polls take 2.5 % of the connection\n" in capsys.readouterr().out


def test_the_share_of_a_connection_is_not_invented(config, capsys):
    text = INVERTER.replace("EVERY", "1 s").replace('"inverter"\nstale', '"meter"\nstale')
    assert main(["check", config(text)]) == 0
    said = capsys.readouterr().out
    assert "  Declared polls take at least 5.0 % of the connection (answer times not known: generic)\n" in said
    assert main(["check", config(text.replace('gap = "50 ms"', 'gap = "0"'))]) == 0
    said = capsys.readouterr().out
    assert "  Declared polls take an unknown share of the connection (answer times not known: generic)\n" in said
    assert "    mirror image-241  meter  holding 0-9  1 s    -     -\n" in said


def test_polls_that_need_all_of_a_connection_are_a_warning(config, capsys):
    assert main(["check", config(INVERTER.replace("EVERY", "100 ms"))]) == 0
    said = capsys.readouterr().out
    assert 'warning: upstream[0]: the polls of mirrors need 150% of its time (upstream "roof")\n' in said
    assert "  help: poll less often\n" in said


SITE = """\
site = "plant-1"
[[line]]
name = "hall-a"
port = "/dev/null"
max_wait = "1 s"
devices = [{ unit = 1, timeout = "400 ms" }, { unit = 2, timeout = "1 s" }]

[[upstream]]
name = "annex"
to = "fleet://plant-2"
units = [{ as = 37, unit = 37 }]
timeout = "3 s"
%s
"""
FLEET = '[fleet]\nservers = ["nats://127.0.0.1"]'


def test_an_upstream_to_this_site_needs_a_quarter_more_than_the_longest_wait_of_its_units(config, capsys):
    path = config(SITE % FLEET)
    main(["check", path])
    said = capsys.readouterr().out
    main(["check", "--json", path])
    picture = json.loads(capsys.readouterr().out)
    longest = max(float(unit["longest_wait_ms"]) for unit in picture["lines"][0]["units"])
    found = {each["units_of"]: each["timeout_ms"] for each in picture["other_sites"]}
    assert 1.25 * longest <= found["hall-a"] < 1.25 * longest + 100
    assert found["annex"] == 6300, "max_wait and timeout here, for who asks through this site, and a quarter: 6.25 s"
    assert f"Other sites\n  UNITS OF  TIMEOUT\n  hall-a    {found['hall-a'] / 1000:g} s\n" in said
    assert "\n  At other sites, the [[upstream]] to fleet://plant-1 needs this timeout or a longer one.\n" in said


def test_who_asks_another_site_is_told_where_the_timeout_is_found(config, capsys):
    main(["check", config(SITE % FLEET)])
    assert "\n  check at plant-2 prints which timeout its units need.\n" in capsys.readouterr().out


def test_without_a_fleet_there_are_no_other_sites(config, capsys):
    path = config(UPSTREAM)
    main(["check", path])
    assert "Other sites" not in capsys.readouterr().out
    main(["check", "--json", path])
    assert json.loads(capsys.readouterr().out)["other_sites"] == []


FAILURES = """\
[[listen]]
name = "scada"
bind = "tcp://127.0.0.1:1502"
on_failure = "silent"

[[line]]
name = "hall-a"
port = "/dev/null"
devices = [{ unit = 41, profile = "weigher" }]
%s

[[line]]
name = "panel"
port = "/dev/zero"
role = "server"
serves = 41
on_failure = "silent"
"""


@pytest.mark.parametrize(
    ("keys", "shown", "retries", "retry_within", "rest"),
    [
        ('retries = 2\nretry_within = "9 s"\nrest = "5 s"', ["retries 2, retry_within 9 s", "rest 5 s"], 2, 9000, 5000),
        (
            'retries = 1\nrest = "off"',
            ["retries 1, retry_within auto: 6.05 s to 6.91 s, by the size of the read", "rest off"],
            1,
            None,
            0,
        ),
        ("", [], 0, None, None),
    ],
)
def test_what_happens_after_a_failure_where_that_is_not_the_default(
    keys, shown, retries, retry_within, rest, config, capsys
):
    path = config(FAILURES % keys)
    assert main(["check", path]) == 0
    said = [line.strip() for line in capsys.readouterr().out.splitlines()]
    assert [line for line in said if line.startswith(("retries", "rest "))] == shown
    assert "Through scada: no response instead of 06, 0A and 0B." in said
    assert "On failure: no response instead of 06, 0A and 0B." in said
    footnote = "With retries it is max_wait + gap + retry_within, if that is longer."
    assert (footnote in said) == bool(retries)
    main(["check", "--json", path])
    line = json.loads(capsys.readouterr().out)["lines"][0]
    assert (line["retries"], line["retry_within_ms"], line["rest_ms"]) == (retries, retry_within, rest)


REMEMBERED = '{"/dev/null silo-1": {"configured": 1, "now": 5}, "/dev/null": {"configured": 19200, "now": 9600}}'


def test_what_was_remembered_is_shown_with_how_to_forget_it(config, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    (tmp_path / "addresses.json").write_text(REMEMBERED)
    assert main(["check", config(FILE)]) == 0
    shown = capsys.readouterr().out
    assert "Remembered from an earlier run\n  hall-a: 9600 baud, the config says 19200; " in shown
    assert "  hall-a: silo-1 is polled at 5, the config says 1; it moved in an earlier run; set unit = 5 in" in shown
    main(["check", config(FILE), "--json"])
    rate, address = json.loads(capsys.readouterr().out)["remembered"]
    assert (rate["baud"], address["device"], address["unit"], address["configured"]) == (9600, "silo-1", 5, 1)


def test_a_state_file_that_cannot_be_read_is_said_too(config, capsys, tmp_path, monkeypatch):
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    (tmp_path / "addresses.json").write_text("{")
    assert main(["check", config(FILE)]) == 0
    assert "the gateway moves it aside" in capsys.readouterr().out
    main(["check", config(FILE), "--json"])
    assert json.loads(capsys.readouterr().out)["remembered"] is None


def test_mirrors_are_in_the_picture(tmp_path, capsys):
    file = tmp_path / "gateway.toml"
    file.write_text(
        '[[line]]\nport = "/dev/ttyUSB9"\ndevices = [{ unit = 1, name = "silo" }]\n'
        '[[image]]\nunit = 241\nname = "m"\nof = "silo"\nread = [{ holding = "0-1", every = "500 ms" }]\n'
    )
    assert main(["check", str(file)]) == 0
    assert "241   m     silo  2 s    holding 0-1 every 500 ms" in capsys.readouterr().out
    assert main(["check", "--json", str(file)]) == 0
    assert json.loads(capsys.readouterr().out)["mirrors"] == [
        {
            "unit": 241,
            "name": "m",
            "of": "silo",
            "stale_ms": 2000.0,
            "polls": [{"addresses": "holding 0-1", "every_ms": 500.0}],
        }
    ]


def test_what_is_heard_is_in_the_picture_with_its_line(tmp_path, capsys):
    file = tmp_path / "gateway.toml"
    file.write_text(
        '[[line]]\nname = "old-plc"\nport = "/dev/ttyUSB9"\nrole = "monitor"\n'
        'devices = [{ unit = 3, as = 63, name = "boiler" }]\n'
        '[[line]]\nname = "panel"\nport = "/dev/ttyUSB8"\nrole = "server"\nserves = [63, 241]\n'
        '[[image]]\nunit = 241\nname = "m"\nof = "boiler"\nread = [{ holding = "0-9" }]\n'
        '[[image]]\nunit = 240\nname = "v"\nmap = [{ at = 0, device = "boiler", holding = "0-1" }]\n'
    )
    assert main(["check", str(file)]) == 0
    said = capsys.readouterr().out
    assert "241   m     boiler  2 s    holding 0-9 heard on old-plc" in said
    assert "  Nothing can be written through a mirror of what is heard: writes get 0A." in said
    assert "  boiler is heard on old-plc: a row is taken from one answer with all of it." in said
    assert re.search(r"63 +boiler +0A: only heard", said)
    assert re.search(r"holding 0-1 +40001 +boiler +- +holding 0-1 +as there +heard +-", said)
    assert main(["check", "--json", str(file)]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["mirrors"][0]["heard_on"] == "old-plc"
    assert told["mirrors"][0]["polls"] == [{"addresses": "holding 0-9", "every_ms": 0.0}]
    assert main(["map", "m", "--config", str(file), "--control", f"{file}.no-socket"]) == 0
    assert re.search(r"holding 0-9 .* boiler holding 0-9 +heard +-", capsys.readouterr().out)


def test_a_unit_in_front_of_which_a_mirror_stands_is_shown_once(tmp_path, capsys):
    file = tmp_path / "gateway.toml"
    mirror = '[[image]]\nunit = 5\nof = "a/5"\nread = [{ holding = "0-1", every = "500 ms" }]\n'
    file.write_text('[[line]]\nname = "a"\nport = "/dev/ttyUSB9"\n' + mirror)
    assert main(["check", "--json", str(file)]) == 0
    (units,) = json.loads(capsys.readouterr().out)["lines"][0]["units"]
    assert units["unit"] == "1-4, 6-247"


def test_an_address_that_this_machine_does_not_have_is_a_warning(config, capsys):
    """192.0.2.1 is an address for documents, which nobody has (RFC 5737)."""
    path = config('[[listen]]\nbind = "tcp://192.0.2.1:502"\n[[access]]\nallow = []\n[[image]]\nunit = 1\ncoils = 1\n')
    assert main(["check", path]) == 0
    assert capsys.readouterr().out.startswith(
        f"{path}:2:8: warning: listen[0].bind: this machine has no address 192.0.2.1 at the moment\n"
        '    2 | bind = "tcp://192.0.2.1:502"\n'
        "      |        ^\n"
        "  help: ip -brief address lists those that it has\n"
    )


@pytest.mark.parametrize(
    ("text", "place", "trouble"),
    [
        ('[[listen]]\nbind = "tcp://[::1%nope0]:502"\n', "2:8: warning: listen[0]", "network interface nope0"),
        ('[web]\nbind = "http://[::1%nope0]:8502"\n', "2:8: warning: web", "network interface nope0"),
        ('[web]\nbind = "http://192.0.2.1:8502"\nproxy = ["192.0.2.2"]\n', "2:8: warning: web", "address 192.0.2.1"),
    ],
)
def test_an_interface_that_is_not_there_and_an_address_of_the_page_are_warnings_too(
    config, capsys, text, place, trouble
):
    path = config(text + "[[image]]\nunit = 1\ncoils = 1\n")
    assert main(["check", path]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{path}:{place}.bind: this machine has no {trouble} at the moment\n")


def test_a_file_that_the_service_may_not_read_is_a_warning(config, capsys, monkeypatch):
    path = config("[[image]]\nunit = 1\ncoils = 1\n")
    monkeypatch.setattr(
        "gateway.cli.verbs.check.with_file_troubles", partial(with_file_troubles, folder=Path(path).parent)
    )
    Path(path).chmod(0o600)
    assert main(["check", path]) == 0
    said = capsys.readouterr().out
    assert said.startswith(f"{path}: warning: the service may not be able to read this file\n")
    assert said.endswith("no errors, 1 warning\n")


@pytest.mark.parametrize(
    ("seconds", "shown"), [(0.0, "at once"), (0.004, "10 ms"), (1.001, "1.01 s"), (21.12, "21.2 s"), (101.1, "102 s")]
)
def test_the_longest_wait_is_never_shown_too_short(seconds, shown):
    assert round_up(seconds) == shown


def test_the_unit_of_the_gateway_itself_is_shown(config, capsys):
    assert main(["check", config(FILE + "\n[self]\nunit = 246\n")]) == 0
    assert " 246 gateway self never registers of the gateway itself" in " ".join(capsys.readouterr().out.split())


PUBLISHED = """
site = "plant-2"
[[listen]]
bind = "tcp://127.0.0.1:0"
[[image]]
unit = 1
name = "shift"
profile = "shift"
holding = 10
[profile.shift]
points = [
  { name = "a", holding = 0 }, { name = "b", holding = 1, write = true }, { name = "c", holding = 2, write = "only" },
  { name = "d", holding = 3 }, { name = "e", holding = 4 },
]
[mqtt]
broker = "mqtt://broker"
publish = [{ device = "shift", every = "1 s" }]
write = true
"""


@pytest.mark.parametrize(
    ("form", "said", "topic"),
    [
        ("home_assistant = true", "  Announced to Home Assistant below homeassistant/\n", "modbus/plant-2/shift"),
        ('prefix = "a/b"', "  JSON; a/b/plant-2/status says whether the gateway is there\n", "a/b/plant-2/shift"),
        ("", "  JSON; modbus/plant-2/status says whether the gateway is there\n", "modbus/plant-2/shift"),
        ('sparkplug = { group = "hall" }', "  Sparkplug B\n", "spBv1.0/hall/DDATA/plant-2/shift"),
    ],
)
def test_topics_are_in_the_picture(tmp_path, capsys, form, said, topic):
    file = tmp_path / "g.toml"
    file.write_text(PUBLISHED + form)
    assert main(["check", str(file)]) == 0
    text = capsys.readouterr().out
    assert "Broker mqtt://broker:1883\n" in text
    assert said in text
    assert f"  shift   {topic}" in text
    assert "a, b, d and 1 more" in text
    assert main(["check", "--json", str(file)]) == 0
    published = json.loads(capsys.readouterr().out)["published"]
    assert published["devices"] == [
        {"device": "shift", "topic": topic, "points": ["a", "b", "d", "e"], "left_out": [], "settable": ["b", "c"]}
    ]


def test_what_is_left_out_is_in_the_picture(tmp_path, capsys):
    file = tmp_path / "g.toml"
    file.write_text(PUBLISHED.replace("every", 'points = ["!b"], every'))
    assert main(["check", str(file)]) == 0
    text = capsys.readouterr().out
    assert "  DEVICE  TOPIC                 POINTS   LEFT OUT  SET THROUGH THE BROKER\n" in text
    assert "  shift   modbus/plant-2/shift  a, d, e  b         c\n" in text
    assert main(["check", "--json", str(file)]) == 0
    (device,) = json.loads(capsys.readouterr().out)["published"]["devices"]
    assert (device["points"], device["left_out"]) == (["a", "d", "e"], ["b"])


def test_how_long_an_outage_is_kept_is_in_the_picture(tmp_path, capsys):
    file = tmp_path / "g.toml"
    file.write_text(PUBLISHED + 'keep = "64 MiB"')
    assert main(["check", str(file)]) == 0
    assert "  Kept while the broker is away: 64 MiB, at least 11 days at 4 values/s\n" in capsys.readouterr().out
    assert main(["check", "--json", str(file)]) == 0
    kept = json.loads(capsys.readouterr().out)["published"]["keep"]
    assert (kept["bytes"], kept["at_least_s"] // 86400, kept["values_per_s"]) == (64 * 2**20, 11, 4)


@pytest.mark.parametrize(
    ("timeout", "owed", "fate"),
    [("200 ms", "1.06 s", "waits"), ("1 s", "3.46 s", "gets 0B, because max_wait is shorter")],
)
def test_the_read_after_that_which_woke_a_device_may_have_to_wait(config, capsys, timeout, owed, fate):
    sleeping = f'devices = [{{ unit = 1, name = "sensor", wake = "10 s", timeout = "{timeout}" }}]\n'
    main(["check", config(f'[[line]]\nport = "/dev/null"\n{sleeping}')])
    assert (
        "  sensor sleeps: after 10 s without a request its first read is sent twice.\n"
        f"  The other answer may come for {owed}; until then, a read with that function {fate}.\n"
    ) in capsys.readouterr().out


def test_profiles_that_are_not_shipped_are_named_with_their_files(config, tmp_path, capsys):
    (tmp_path / "profiles").mkdir()
    (tmp_path / "profiles" / "v80.toml").write_text("[profile.v80]\n")
    line = '[[line]]\nport = "/dev/null"\ndevices = [{ unit = 1, profile = "v80" }, { unit = 2, profile = "own" }]\n'
    file = config(line + "[profile.own]\n")
    assert main(["check", file]) == 0
    said = capsys.readouterr().out
    place = f"{tmp_path}/profiles/v80.toml:1"
    assert f"\n\nProfiles\n  NAME  FROM\n  own   gateway.toml:4\n  v80   {place}, hides the shipped one\n\n" in said
    assert main(["check", "--json", file]) == 0
    assert json.loads(capsys.readouterr().out)["profiles"] == [
        {"name": "own", "from": "gateway.toml:4", "hides": []},
        {"name": "v80", "from": place, "hides": ["shipped"]},
    ]


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ("", "kept for 24 h in slots of 1 min; room for about 1000 points that always change, 2 points here\n"),
        ('values = "6 h"', "kept for 6 h in slots of 1 min; room for about 4"),
        ('values = "25 h"', "kept for 25 h in slots of 10 min; room for about 8"),
        ('values = "31 min"', "kept for 31 min in slots of 1 min; room for about 3"),
        ('values = "7 days"', "kept for 7 days in slots of 10 min; room for about 12"),
        ('values = "0"', ""),
    ],
)
def test_for_how_many_points_trends_have_room(config, capsys, values, said):
    points = '[{ name = "a", holding = 0 }, { name = "b", coils = 1 }, { name = "c", holding = 3, write = "only" }]'
    web = f'[web]\nbind = "http://127.0.0.1:8502"\n{values}\n'
    file = config(f'[[line]]\nport = "/dev/null"\ndevices = [{{ unit = 1, points = {points} }}]\n{web}')
    assert main(["check", file]) == 0
    text = capsys.readouterr().out
    assert ("Trends\n" in text) == bool(said)
    assert said in text
    assert main(["check", "--json", file]) == 0
    trends = json.loads(capsys.readouterr().out)["trends"]
    assert (trends is None) == (not said)
    assert trends is None or trends["points"] == 2


def test_more_points_than_trends_have_room_for(config, capsys):
    points = ", ".join(f'{{ name = "p{at}", holding = {at} }}' for at in range(1500))
    web = '[web]\nbind = "http://127.0.0.1:8502"\n'
    assert (
        main(["check", config(f'[[line]]\nport = "/dev/null"\ndevices = [{{ unit = 1, points = [{points}] }}]\n{web}')])
        == 0
    )
    assert "1500 points here: the oldest slots are dropped earlier, if more than that change" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("values", "what"),
    [('"8 days"', "must be at most 7 days"), ('"5 min"', "must be at least 10 min"), ("24", "a duration needs a unit")],
)
def test_how_long_trends_cannot_be_kept(config, capsys, values, what):
    assert main(["check", config(f'[web]\nbind = "http://127.0.0.1:8502"\nvalues = {values}\n')]) == 1
    assert what in capsys.readouterr().out
