"""The units made in Python of a running gateway: their objects, and where their calls are carried out."""

import asyncio
from collections.abc import Callable, Container, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

from gateway.clock.loop_thread import ENDING_TIME, LoopThread
from gateway.config.plan.settings import Plan
from gateway.events import CustomUnitsLeft, Emit
from gateway.images.custom_image import CustomImage
from gateway.images.custom_unit import FIND, CustomUnit
from gateway.images.drivers.custom_driver import NOBODY_ELSE, CustomDriver
from gateway.images.image import Image, ImageSettings
from gateway.runtime.custom_units import made
from gateway.runtime.draining import until
from gateway.trace.ring import Ring

#: How long the loop waits for what a thread that has ended has told it, in seconds.
_LAST_WORDS: Final = 0.05

#: Units made of the classes that the config names, by unit and class.
MadeUnits = dict[tuple[int, str], CustomUnit]


def units_made(images: Iterable[ImageSettings], given: Container[int], folder: Path) -> MadeUnits:
    """Make the units that the program has not `given`. Blocks, as the code of their authors may.

    Raises:
        ConfigError: a class cannot be used.
    """
    wanted = (one for one in images if one.python and one.unit not in given)
    return {(one.unit, one.python): made(one, folder) for one in wanted}


class CustomImages:
    """Makes the images of units made in Python, and ends them.

    Those that the program has `given`, by unit, are called in its loop. All others are made of the classes that the
    config names, of modules that may lie in `folder` too, and are called in one thread: one that blocks stops nothing
    but these.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        emit: Emit,
        ring: Ring,
        given: Mapping[int, CustomUnit] | None = None,
        folder: Path | None = None,
        first: MadeUnits | None = None,
    ) -> None:
        """`first` are those that were made before, by `units_made`."""
        #: Finds a unit of the gateway for `CustomUnit.unit`; set before the first request by what can ask units.
        self.find: Callable[[int | str], Any] | None = None
        self._loop = loop
        self._emit = emit
        self._ring = ring
        self._given = given or {}
        #: A program may give a unit two numbers, and a reload a second image.
        self._turns = {id(unit): asyncio.Lock() for unit in self._given.values()}
        self._folder = folder or Path()
        self._thread = LoopThread("custom units")
        #: Those that were made and have no image yet.
        self._made = first or {}
        self._drivers: list[CustomDriver] = []

    def prepare(self, plan: Plan, before: Plan) -> None:
        """Make the units that are new in a plan. Blocks, as the code of their authors may.

        Raises:
            ConfigError: a class cannot be used.
        """
        new = (one for one in plan.images if one not in before.images)
        self._made = units_made(new, self._given, self._folder)

    def image(self, settings: ImageSettings) -> CustomImage:
        """Make the image of a unit, of what was made for it if it was.

        Raises:
            ConfigError: as `prepare`.
        """
        unit, there = self._given.get(settings.unit), None
        if unit is None:
            there = self._thread.call_soon
            key = (settings.unit, settings.python)
            unit = self._made.pop(key) if key in self._made else made(settings, self._folder)
        object.__setattr__(unit, FIND, self._found)  # it may be a frozen dataclass
        turn = self._turns.get(id(unit), NOBODY_ELSE)
        driver = CustomDriver(settings, unit, self._loop, self._emit, self._ring, there, turn)
        self._drivers.append(driver)
        return driver.image

    def keep(self, images: Iterable[Image]) -> None:
        """Close all but these: their requests fail, and their calls are cancelled."""
        kept = [id(image) for image in images]
        for driver in self._drivers:
            if id(driver.image) not in kept:
                driver.close()
        self._drivers = [each for each in self._drivers if id(each.image) in kept or each.is_busy]

    async def close(self) -> None:
        """Close all, and wait for their calls and the thread to end; what does not in ENDING_TIME is left behind."""
        self.keep(())
        end = self._loop.time() + ENDING_TIME
        await self._thread.close()
        left = max(end - self._loop.time(), _LAST_WORDS)
        await until(lambda: not any(driver.is_busy for driver in self._drivers), left)
        busy = tuple(driver.image.name for driver in self._drivers if driver.is_busy)
        if busy:
            self._emit(CustomUnitsLeft(busy))

    def _found(self, unit: int | str) -> Any:
        if self.find is None:
            raise RuntimeError("this unit belongs to no gateway that has been started")
        return self.find(unit)
