"""Who knows mbpoll finds the words to use here."""

import pytest

from gateway.cli.main import main


@pytest.mark.parametrize(
    ("mbpoll", "here"),
    [
        ("read -a 41 -t 4 -r 108 -c 3", "read 41 holding 107-109"),
        ("read -a 41 -t 4 -0 -r 107 -1 127.0.0.1", "read 41 holding 107"),
        ("read -a 41 -t 4:float -B -r 1", "read 41 holding 0-1 float32"),
        ("read -a 41 -t 3:int -c 2", "read 41 input 0-3 int32 --swap words"),
        ("read -t 0 -c 16 -r 1", "read 1 coils 0-15"),
        ("read 41 -t 1", "read 1 discrete 0"),
        ("read -a 5 -t 4:hex -p 5020", "read 5 holding 0 --tcp HOST:5020"),
        ("read -a 5 -b 9600 /dev/ttyUSB0", "read 5 holding 0 --baud 9600"),
        ("write -a 52 -t 4 -0 -r 30 127.0.0.1 1234 5678", "write 52 holding 30 1234 5678"),
        ("write -a 52 -t 0 -r 1", "write 52 coils 0 VALUE"),
        ("read -a x -c many -r some", "read x holding 0"),
    ],
)
def test_its_options_are_answered_with_the_command_that_means_the_same(mbpoll, here, capsys):
    assert main(mbpoll.split()) == 2
    told = capsys.readouterr()
    assert told.out == ""
    assert "options of mbpoll" in told.err
    assert told.err.splitlines()[-1] == f"  help: modbus-gateway {here}"


def test_they_are_not_in_the_help(capsys):
    with pytest.raises(SystemExit):
        main(["read", "--help"])
    assert "-a " not in capsys.readouterr().out
