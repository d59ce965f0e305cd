"""The units made in Python of a running gateway: when each is made, how long it stays, and whose it is."""

import asyncio
import sys
from dataclasses import dataclass

import pytest

from gateway.config.load import parse
from gateway.config.resolve import resolve
from gateway.errors import ConfigError
from gateway.images.custom_unit import CustomUnit
from gateway.runtime.custom_images import CustomImages
from gateway.trace.ring import Ring
from kit.asker import Asker

ROW = """
[[image]]
unit = {unit}
python = "{module}:{name}"
timeout = "{timeout}"
"""
MODULE = """
from gateway import CustomUnit
made = []

class Counted(CustomUnit):
    def __init__(self):
        made.append(self)

    def __len__(self):  # so it is false
        return 0

    async def read(self, area, address, count):
        return [0] * count

class Broken(Counted):
    def __init__(self):
        raise OSError("no sensor")
"""


@pytest.fixture
def module(tmp_path):
    name = f"counted_{tmp_path.name}".replace("-", "_")
    (tmp_path / f"{name}.py").write_text(MODULE)
    yield name
    sys.modules.pop(name, None)
    if str(tmp_path) in sys.path:
        sys.path.remove(str(tmp_path))


def plan(*rows: tuple[int, str, str], module: str = "own"):
    text = '[[listen]]\nbind = "tcp://127.0.0.1:0"\n'
    text += "".join(ROW.format(unit=unit, name=name, timeout=timeout, module=module) for unit, name, timeout in rows)
    loaded = parse(text)
    assert loaded.config is not None, loaded.problems
    return resolve(loaded.config)


def images(folder=None, **given: CustomUnit) -> CustomImages:
    loop = asyncio.get_running_loop()
    units = {int(name.removeprefix("unit")): unit for name, unit in given.items()}
    return CustomImages(loop, lambda _: None, Ring(), units, folder)


async def test_a_reload_makes_what_is_new_and_nothing_else(module, tmp_path):
    custom = images(tmp_path)
    first = plan((60, "Counted", "1 s"), module=module)
    kept = custom.image(first.images[0])
    made = sys.modules[module].made
    assert len(made) == 1
    second = plan((60, "Counted", "1 s"), (61, "Counted", "1 s"), module=module)
    custom.prepare(second, first)
    assert len(made) == 2
    custom.image(second.images[1])
    custom.keep([kept])
    assert len(made) == 2  # it was made before
    third = plan((60, "Counted", "2 s"), module=module)
    custom.prepare(third, second)
    assert len(made) == 3


async def test_one_that_cannot_be_made_is_an_error_in_words(module, tmp_path):
    broken = plan((60, "Broken", "1 s"), module=module)
    with pytest.raises(ConfigError, match=r"Broken cannot be made: OSError: no sensor \(.*counted.*\.py, line 17\)"):
        images(tmp_path).prepare(broken, plan((61, "Counted", "1 s"), module=module))


async def test_what_the_program_gives_is_never_made(module, tmp_path):
    unit, found = CustomUnit(), plan((60, "Broken", "1 s"), module=module)
    custom = images(tmp_path, unit60=unit)
    custom.prepare(found, plan((61, "Counted", "1 s"), module=module))
    custom.image(found.images[0])
    assert module not in sys.modules
    custom.find = {"meter": "found"}.get
    assert unit.unit("meter") == "found"


@dataclass(frozen=True)
class Frozen(CustomUnit):
    """Nothing can be set, and it equals others."""

    async def read(self, area, address, count):
        return [self.unit(1)] * count


async def test_a_frozen_dataclass_may_be_a_unit():
    unit = Frozen()
    custom = images(unit60=unit, unit61=Frozen())
    image = custom.image(plan((60, "Own", "1 s")).images[0])
    custom.find = {1: 7}.get
    assert (await ask(image)).answers == ["03 02 00 07"]


class Alone(CustomUnit):
    """Would notice two calls at once."""

    def __init__(self) -> None:
        self.at_once = self.most = 0

    async def read(self, area, address, count):
        self.at_once += 1
        self.most = max(self.most, self.at_once)
        try:
            await asyncio.sleep(0.2)
        except asyncio.CancelledError:
            await asyncio.sleep(0.2)
        finally:
            self.at_once -= 1
        return [0] * count


async def ask(image, times: int = 1) -> Asker:
    client, now = Asker(), asyncio.get_running_loop().time()
    for _ in range(times):
        image.submit(client.ask("03 0000 0001", unit=60, now=now), now)
    await asyncio.sleep(0.1)
    return client


async def test_a_unit_with_two_numbers_does_one_thing_at_once():
    unit = Alone()
    custom, found = images(unit60=unit, unit61=unit), plan((60, "Own", "1 s"), (61, "Own", "1 s"))
    one, other = [await ask(custom.image(each)) for each in found.images]
    await asyncio.sleep(1.0)
    assert (one.answers, other.answers, unit.most) == (["03 02 00 00"], ["03 02 00 00"], 1)


async def test_nor_does_one_that_a_reload_has_changed():
    unit = Alone()
    custom = images(unit60=unit)
    before = await ask(custom.image(plan((60, "Own", "1 s")).images[0]))
    new = custom.image(plan((60, "Own", "2 s")).images[0])
    custom.keep([new])
    after = await ask(new)
    await asyncio.sleep(1.0)
    assert (before.answers, after.answers, unit.most) == (["83 0B"], ["03 02 00 00"], 1)


async def test_closing_waits_for_those_that_end():
    unit = Alone()
    custom = images(unit60=unit)
    client = await ask(custom.image(plan((60, "Own", "1 s")).images[0]))
    await custom.close()
    assert (client.answers, unit.at_once) == (["83 0B"], 0)
