"""`profile`: what a kind of device accepts, its answer times, and the limits that follow."""

import json
import os
import re
from textwrap import dedent

import pytest

from gateway.cli.main import main
from gateway.profiles import shipped_names
from gateway.profiles.columns import COLUMNS

SHIPPED = dedent(
    """\
    NAME  TITLE                   MAKER  SEEN            FROM
    mint  Mint motion controller  -      printed frames  shipped
    """
)


@pytest.mark.parametrize("words", [["profile", "list", "motion"], ["profile", "list", "MINT", "--baud", "9600"]])
def test_a_list_of_those_with_a_word(words, capsys):
    assert main(words) == 0
    assert capsys.readouterr().out == SHIPPED


@pytest.mark.parametrize("words", [["profile"], ["profile", "list"]])
def test_without_a_name_all_are_listed(words, capsys):
    assert main(words) == 0
    said = capsys.readouterr().out.splitlines()
    assert [line.split()[0] for line in said] == ["NAME", *shipped_names()]


def test_a_word_that_no_profile_has(capsys):
    assert main(["profile", "list", "nothing"]) == 1
    assert capsys.readouterr().out == 'no profile has "nothing" in its name, title or maker\n'
    assert main(["profile", "list", "nothing", "--json"]) == 1
    assert capsys.readouterr().out == "[]\n"


def test_a_profile_with_a_timing_table(capsys):
    assert main(["profile", "mint", "--mode", "ascii"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        mint: Mint motion controller

          source        Mint motion controllers as Modbus ASCII servers, application note of the manufacturer
          seen          printed frames
          functions     1, 2, 3, 5, 16, 23
          most items    99 items of function 3
          addresses     holding 1-99
          end of frame  3.5 characters of silence
          margin        1.5 x the answer times
          time-out      1 s for functions without an answer time

        Answer times
          FUNCTION  ITEMS  TIME
          1         1      10 ms
          1         16     10 ms
          2         1      10 ms
          2         16     10 ms
          3         1      10 ms
          3         99     420 ms
          5         1      10 ms
          16        1      10 ms
          16        99     240 ms
          23        1      14 ms
          23        99     500 ms

        Points
          NAME      AREA      ADDRESS  TYPE   UNIT  WRITE
          comms-*   holding   1-99     int16        yes
          output-*  coils     0-15     bit          yes
          input-*   discrete  0-15     bit          no

        Time limits, counted from the end of the request: ascii 19200 7E1, latency 5 ms
          FUNCTION  LIMIT FOR 1 ITEM  MOST ITEMS  LIMIT FOR MOST
          1         26.8 ms           2000        286 ms
          2         26.8 ms           2000        286 ms
          3         27.8 ms           99          847 ms
          5         28.9 ms           1           28.9 ms
          16        28.9 ms           99          374 ms
          23        33.8 ms           99          967 ms
        """
    )


def test_a_profile_that_refuses_nothing(capsys):
    assert main(["profile", "generic"]) == 0
    said = capsys.readouterr().out
    assert "  functions     all\n" in said
    assert "  most items    as the protocol allows\n" in said
    assert "  addresses     all\n" in said
    assert "Answer times" not in said


def test_limits_at_another_rate_and_format(capsys):
    """255 characters of 10 bits at 9600 baud are 265.6 ms."""
    assert main(["profile", "weigher", "--baud", "9600", "--format", "8n1"]) == 0
    said = capsys.readouterr().out
    assert "rtu 9600 8N1" in said
    assert "  3         1.01 s            125         1.27 s\n" in said


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--baud", "fast"], 'argument --baud: "fast" is not a valid rate; write a number such as 9600'),
        (["--baud", "0"], 'argument --baud: "0" is not a valid rate; write a number such as 9600'),
        (["--format", "9E1"], 'argument --format: "9E1" is not a valid character format'),
        (["--mode", "tcp"], "argument --mode: invalid choice: 'tcp'"),
    ],
)
def test_wrong_usage(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["profile", "mint", *words])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err


def test_rtu_needs_8_data_bits_here_too(capsys):
    assert main(["profile", "mint", "--mode", "rtu", "--format", "7E1"]) == 2
    said = "modbus-gateway: error: RTU needs 8 data bits, and 7E1 has 7\n  help: is it --mode ascii?\n"
    assert capsys.readouterr().err == said
    assert main(["profile", "mint", "--mode", "ascii", "--format", "7E1"]) == 0


def test_an_unknown_profile_is_wrong_usage(capsys):
    assert main(["profile", "mnt"]) == 2
    what, remedy = capsys.readouterr().err.splitlines()
    assert what == 'modbus-gateway: error: there is no profile "mnt"'
    assert remedy == '  help: did you mean "mint"? modbus-gateway profile list shows all'


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "gateway.toml"
    path.write_text('[[line]]\nport = "/dev/null"\n[profile.own]\ncoils = 16\n', encoding="utf-8")
    return path


def test_the_profiles_of_a_config_file(config, capsys):
    assert main(["profile", "--config", str(config)]) == 0
    assert ["own", "-", "-", "gateway.toml:3"] in [line.split() for line in capsys.readouterr().out.splitlines()]
    assert main(["profile", "own", "--config", str(config)]) == 0
    assert capsys.readouterr().out.startswith("own\n\n  from          gateway.toml:3\n  functions     all\n")


def test_a_config_file_with_errors(config, capsys):
    config.write_text("[[line]]\n", encoding="utf-8")
    assert main(["profile", "own", "--config", str(config)]) == 1
    assert capsys.readouterr().err == f"{config}:1:1: error: line[0].port: port is missing\n"


def test_the_list_as_json(capsys):
    assert main(["profile", "--json"]) == 0
    of_name = {each["name"]: each for each in json.loads(capsys.readouterr().out)}
    assert of_name["mint"] == {
        "name": "mint",
        "title": "Mint motion controller",
        "maker": "",
        "seen": "printed frames",
        "from": "shipped",
        "hides": [],
    }


def test_a_profile_as_json(capsys):
    assert main(["profile", "mint", "--json"]) == 0
    picture = json.loads(capsys.readouterr().out)
    assert picture["timing"][0] == {"function": 1, "items": 1, "time_ms": 10.0}
    assert picture["time_limits"][0]["one_item_ms"] == 26.771
    assert [point["name"] for point in picture["points"]][97:101] == ["comms-98", "comms-99", "output-0", "output-1"]
    del picture["timing"], picture["time_limits"], picture["points"]
    assert picture == {
        "name": "mint",
        "title": "Mint motion controller",
        "maker": "",
        "source": "Mint motion controllers as Modbus ASCII servers, application note of the manufacturer",
        "seen": "printed frames",
        "from": "shipped",
        "hides": [],
        "identity": None,
        "functions": [1, 2, 3, 5, 16, 23],
        "limits": {"3": 99},
        "areas": {"holding": [[1, 99]]},
        "wide": {},
        "max_gap": 0,
        "write_function": "auto",
        "coil_values": "checked",
        "idle_chars": 3.5,
        "margin": 1.5,
        "timeout_ms": 1000.0,
        "wake_ms": 0.0,
        "line": {"mode": "ascii", "baud": 19200, "format": "7E1"},
    }
    assert main(["profile", "generic", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["functions"] is None


METER = """\
[profile.meter]
title = "Meter"
maker = "Example"
source = "Meter, protocol, edition 2, pages 3-9"
seen = "simulated"
identity = { holding = 0, equals = 0x1234 }
functions = [3, 4, 6, 16, 22]
wide = { holding = "5000-5001" }
max_gap = 8
write_function = "multiple"
wake = "10 s"
coil_values = "any"
points = [
  { name = "flow", input = 12, type = "int16", scale = 0.1, offset = -40, invalid = 0x8000, unit = "m³/h" },
  { name = "alarm", holding = 8, bit = 3 },
  { name = "mode", holding = 8, bits = "4-6", labels = { 0 = "off", 1 = "on" }, write = true },
  { name = "half", holding = 21, byte = "low" },
  { name = "limit", holding = 20, min = 1, max = 9.5, write = true, write_at = 120 },
  { name = "power", holding = 30, type = "int32", swap = "words", scale_from = "sf" },
  { name = "sf", holding = 32, type = "int16" },
  { name = "top", holding = 40, swap = "bytes", write = true, max = 5, write_function = "single" },
  { name = "text", holding = 41, type = "string", length = 4, swap = "both" },
  { name = "least", holding = 50, write = true, min = 5 },
]
"""


@pytest.fixture
def meter(tmp_path):
    file = tmp_path / "draft.toml"
    file.write_text(METER, encoding="utf-8")
    return file


@pytest.fixture
def own(tmp_path, monkeypatch):
    """The folder of profiles of this machine."""
    folder = tmp_path / "etc" / "profiles"
    for module in ("gateway.cli.verbs.profile", "gateway.cli.profiles.known"):
        monkeypatch.setattr(f"{module}.OWN_PROFILES", folder)
    return folder


def test_all_that_a_profile_may_say_is_shown(meter, own, capsys):
    assert main(["profile", "add", str(meter)]) == 0
    capsys.readouterr()
    assert main(["profile", "meter"]) == 0
    said = capsys.readouterr().out
    assert said.startswith(
        dedent(
            f"""\
            meter: Meter

              from           {own}/meter.toml:1
              maker          Example
              source         Meter, protocol, edition 2, pages 3-9
              seen           simulated
              recognised by  holding 0 is 4660
              functions      3, 4, 6, 16, 22
              most items     as the protocol allows
              addresses      all
              four bytes     holding 5000-5001: registers of four bytes each
              gaps           points are read together over up to 8 addresses between them
              writes         points with functions 15 and 16
              coils          function 05 with any value
              sleeps         after 10 s without a request
              end of frame   3.5 characters of silence
              margin         1.5 x the answer times
              time-out       1 s for functions without an answer time
            """
        )
    )
    points = said.partition("Points\n")[2].partition("\n\n")[0].splitlines()
    assert [re.split("  +", line.strip()) for line in points] == [
        ["NAME", "AREA", "ADDRESS", "TYPE", "SCALE", "UNIT", "WRITE", "LIMITS", "NO VALUE", "LABELS"],
        ["flow", "input", "12", "int16", "x 0.1 - 40", "m³/h", "no", "0x8000"],
        ["alarm", "holding", "8", "uint16, bit 3", "no"],
        ["mode", "holding", "8", "uint16, bits 4-6", "yes", "0 off, 1 on"],
        ["half", "holding", "21", "uint8, low byte", "no"],
        ["limit", "holding", "20", "uint16", "yes, at 120", "1 to 9.5"],
        ["power", "holding", "30", "int32, words swapped", "x 10^sf", "no"],
        ["sf", "holding", "32", "int16", "no"],
        ["top", "holding", "40", "uint16, bytes swapped", "yes, single function", "up to 5"],
        ["text", "holding", "41", "string, 4 registers, words and bytes swapped", "no"],
        ["least", "holding", "50", "uint16", "yes", "from 5"],
    ]


def test_what_follows_from_a_range_or_a_type_is_shown(own, capsys):
    own.mkdir(parents=True)
    points = (
        '{ name = "low", holding = 9, type = "int8" }, { name = "k-*", coils = "0-3", write = true, write_at = 16 }'
    )
    (own / "board.toml").write_text(f"[profile.board]\npoints = [{points}]\n", encoding="utf-8")
    assert main(["profile", "board"]) == 0
    rows = capsys.readouterr().out.partition("Points\n")[2].partition("\n\n")[0].splitlines()[1:]
    assert [re.split("  +", line.strip()) for line in rows] == [
        ["low", "holding", "9", "int8, low byte", "no"],
        ["k-*", "coils", "0-3", "bit", "yes, at 16-19"],
    ]


def test_a_file_is_added(meter, own, capsys):
    """The service can read it, even if root's files are for root."""
    before = os.umask(0o077)
    assert main(["profile", "add", str(meter)]) == 0
    os.umask(before)
    file = own / "meter.toml"
    assert capsys.readouterr().out == (
        f'meter is in {file}.\nIn the config: profile = "meter". Then: modbus-gateway reload\n'
    )
    assert file.read_text(encoding="utf-8") == METER
    assert (own.stat().st_mode & 0o777, file.stat().st_mode & 0o777) == (0o755, 0o644)
    assert [each.name for each in own.iterdir()] == ["meter.toml"]
    assert main(["profile", "list", "meter", "--json"]) == 0
    listed = {each["name"]: each["from"] for each in json.loads(capsys.readouterr().out)}
    assert listed["meter"] == f"{file}:1"


def test_a_file_that_is_there_is_replaced_by_force_only(meter, own, capsys):
    assert main(["profile", "add", str(meter)]) == 0
    assert main(["profile", "add", str(meter)]) == 0
    meter.write_text("[profile.meter]\n")
    capsys.readouterr()
    assert main(["profile", "add", str(meter)]) == 1
    said = f"modbus-gateway: error: {own}/meter.toml is there already, and differs\n  help: --force replaces it\n"
    assert capsys.readouterr().err == said
    assert (own / "meter.toml").read_text(encoding="utf-8") == METER
    assert main(["profile", "add", "--force", str(meter)]) == 0
    assert (own / "meter.toml").read_text(encoding="utf-8") == "[profile.meter]\n"


def test_what_an_added_file_hides_is_told(meter, own, tmp_path, capsys):
    meter.write_text("[profile.mint]\n")
    assert main(["profile", "add", str(meter)]) == 0
    assert capsys.readouterr().out.startswith(f"mint is in {own}/mint.toml, and hides the shipped one.\n")
    config = tmp_path / "gateway.toml"
    config.write_text('[[line]]\nport = "/dev/null"\n')
    assert main(["profile", "add", str(meter), "--config", str(config)]) == 0
    said = f"mint is in {tmp_path}/profiles/mint.toml, and hides {own}/mint.toml and the shipped one.\n"
    assert capsys.readouterr().out.startswith(said)
    assert main(["profile", "add", str(meter), "--to", str(tmp_path / "sub" / "folder")]) == 0
    assert (tmp_path / "sub" / "folder" / "mint.toml").exists()


def test_a_file_with_errors_is_not_added(meter, own, capsys):
    meter.write_text('[profile.meter]\npoints = [{ name = "a", holding = 1, scale = 0 }]\n')
    assert main(["profile", "add", str(meter)]) == 1
    said = f"{meter}:2:46: error: profile.meter.points[0].scale: must not be 0\n"
    assert capsys.readouterr().err == said
    assert not own.exists()


def test_a_folder_that_cannot_be_written(meter, own, tmp_path, capsys):
    own.parent.mkdir()
    own.touch()
    assert main(["profile", "add", str(meter)]) == 1
    assert capsys.readouterr().err == f"modbus-gateway: error: {own}/meter.toml: Not a directory\n"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["add"], "profile add needs a file\n  help: modbus-gateway profile add FILE\n"),
        (["mint", "v80"], "v80 is one word too many\n  help: modbus-gateway profile mint\n"),
    ],
)
def test_words_that_are_missing_or_too_many(words, said, capsys):
    assert main(["profile", *words]) == 2
    assert capsys.readouterr().err == f"modbus-gateway: error: {said}"


def test_a_name_that_no_file_can_have_is_not_added(meter, own, capsys):
    meter.write_text('[profile."a/b"]\n')
    assert main(["profile", "add", str(meter)]) == 2
    assert '"a/b" cannot be the name of a file' in capsys.readouterr().err


def test_a_broken_file_hides_no_others_in_the_list(meter, own, capsys):
    own.mkdir(parents=True)
    (own / "bad.toml").write_text("[profile.bad]\nmargin = 0\n")
    assert main(["profile", "list", "mint"]) == 1
    shown = capsys.readouterr()
    assert shown.out == SHIPPED
    assert shown.err == f"{own}/bad.toml:2:10: error: profile.bad.margin: must be at least 1\n"
    assert main(["profile", "bad"]) == 1
    assert capsys.readouterr().err == shown.err


@pytest.mark.parametrize("words", [["profile", "bad"], ["profile", "bad", "--csv"], ["profile", "list", "bad"]])
def test_a_profile_that_check_refuses_is_not_shown(words, own, capsys):
    own.mkdir(parents=True)
    (own / "bad.toml").write_text('[profile.bad]\npoints = [{ name = "a", holding = 1, bit = 40 }]\n')
    assert main(words) == 1
    assert (
        f"{own}/bad.toml:2:44: error: profile.bad.points[0].bit: a uint16 has the bits 0 to" in capsys.readouterr().err
    )


def test_points_as_csv(meter, own, capsys):
    main(["profile", "add", str(meter)])
    capsys.readouterr()
    assert main(["profile", "meter", "--csv"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[:3] == [
        ",".join(COLUMNS),
        "flow,input,12,30013,int16,,,0.1,-40,,m³/h,r,,,32768,,,,,",
        "alarm,holding,8,40009,uint16,,3,,,,,r,,,,,,,,",
    ]
    assert said[3] == "mode,holding,8,40009,uint16,,4-6,,,,,rw,,,,0=off;1=on,,,,"
