"""The conversations of tests/vectors/image-cases.toml."""

import tomllib
from pathlib import Path

import pytest

from gateway.images.image import Image
from gateway.modbus.codes import Area
from images.asking import ask, image

_CASES = tomllib.loads((Path(__file__).parents[1] / "vectors" / "image-cases.toml").read_text())["case"]


def _image(initial: list) -> Image:
    bits, registers = ((0, 299),), ((0, 199),)
    runs = {Area(area): ((start, tuple(values)),) for area, start, values in initial}
    return image(coils=bits, discrete=bits, input=registers, holding=registers, initial=runs)


@pytest.mark.parametrize("case", _CASES, ids=lambda case: case["title"])
def test_each_request_gets_the_response_of_the_case(case):
    image = _image(case.get("initial", []))
    for request, response in case["talk"]:
        assert ask(image, request) == bytes.fromhex(response).hex(" ").upper(), request
