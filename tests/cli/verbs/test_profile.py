"""`profile`: what a kind of device accepts, its answer times, and the limits that follow."""

import json
from textwrap import dedent

import pytest

from gateway.cli.main import main


def test_without_a_name_all_are_listed(capsys):
    assert main(["profile"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        NAME     TITLE                                 FROM
        generic  Any Modbus device                     built in
        mint     Mint motion controller                built in
        v80      V80 and PPC programmable controllers  built in
        weigher  Weighing transducer                   built in
        """
    )


def test_a_profile_with_a_timing_table(capsys):
    assert main(["profile", "mint", "--mode", "ascii"]) == 0
    assert capsys.readouterr().out == dedent(
        """\
        mint: Mint motion controller

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
    said = "modbus-gateway: error: RTU needs 8 data bits, and 7E1 has 7; is it --mode ascii?\n"
    assert capsys.readouterr().err == said
    assert main(["profile", "mint", "--mode", "ascii", "--format", "7E1"]) == 0


def test_an_unknown_profile_is_wrong_usage(capsys):
    assert main(["profile", "mnt"]) == 2
    said = 'modbus-gateway: error: there is no profile "mnt"; did you mean "mint"?\n'
    assert capsys.readouterr().err == said


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "gateway.toml"
    path.write_text('[[line]]\nport = "/dev/null"\n[profile.own]\ncoils = 16\n', encoding="utf-8")
    return path


def test_the_profiles_of_a_config_file(config, capsys):
    assert main(["profile", "--config", str(config)]) == 0
    assert "own                                            gateway.toml:3\n" in capsys.readouterr().out
    assert main(["profile", "own", "--config", str(config)]) == 0
    assert capsys.readouterr().out.startswith("own\n\n  functions     all\n")


def test_a_config_file_with_errors(config, capsys):
    config.write_text("[[line]]\n", encoding="utf-8")
    assert main(["profile", "own", "--config", str(config)]) == 1
    assert capsys.readouterr().err == f"{config}:1:1: error: line[0].port: port is missing\n"


def test_the_list_as_json(capsys):
    assert main(["profile", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)[1] == {
        "name": "mint",
        "title": "Mint motion controller",
        "from": "built in",
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
        "functions": [1, 2, 3, 5, 16, 23],
        "limits": {"3": 99},
        "areas": {"holding": [[1, 99]]},
        "coil_values": "checked",
        "idle_chars": 3.5,
        "margin": 1.5,
        "timeout_ms": 1000.0,
        "line": {"mode": "ascii", "baud": 19200, "format": "7E1"},
    }
    assert main(["profile", "generic", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["functions"] is None
