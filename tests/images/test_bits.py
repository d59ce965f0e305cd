"""Writes to bits of a register, `in_one_turn`: an image does them at once, a mirror passes them on to its device."""

import pytest

from gateway.images.image import Image
from gateway.images.ordered import ForwardedOrigin
from gateway.modbus.codes import Area
from gateway.profiles.profile import Profile
from gateway.request import Request
from images.asking import UNIT, Answers, ask, image
from images.test_mirror import Bench, Client

SET = "16 00 08 FF EF 00 10"


def ask_for_bits(image: Image) -> str:
    answers = Answers()
    request = Request(UNIT, bytes.fromhex(SET), answers, 0.0)
    request.in_one_turn = 6
    image.submit(request, 0.0)
    assert request.in_one_turn == 0  # what went on is function 22: see the audit
    (answer,) = answers.came
    return answer.hex(" ").upper()


@pytest.mark.parametrize("functions", [None, {3, 6}, {3, 22}])
def test_an_image_writes_them(functions: set[int] | None) -> None:
    profile = Profile("any", functions=None if functions is None else frozenset(functions))
    shift_data = image(profile, {Area.HOLDING: ((8, (0x1201,)),)}, holding=((8, 8),))
    assert ask_for_bits(shift_data) == SET
    assert ask(shift_data, "03 0008 0001") == "03 02 12 11"


def test_an_image_that_cannot_be_written_refuses_them() -> None:
    profile = Profile("reads", functions=frozenset({3}))
    assert ask_for_bits(image(profile, holding=((8, 8),))) == "96 01"


def test_registers_that_an_image_does_not_have_are_02() -> None:
    assert ask_for_bits(image(holding=((0, 7),))) == "96 02"


def test_a_mirror_passes_them_on() -> None:
    bench = Bench()
    client = Client(bench)
    request = Request(241, bytes.fromhex(SET), client, 0.0)
    request.in_one_turn = 6
    bench.mirror.submit(request, 0.0)
    (passed_on,) = [each for each in bench.asked if isinstance(each.origin, ForwardedOrigin)]
    assert (passed_on.pdu, passed_on.in_one_turn) == (request.pdu, 6)
    passed_on.in_one_turn = 0  # the device has function 22
    passed_on.respond(passed_on.pdu)
    assert request.in_one_turn == 0
    assert client.came() == [SET]
