"""The operations `config` and `check-config`: the config in use, and what `check` says of a text for it."""

import asyncio
from collections.abc import Sequence
from functools import partial
from typing import Final

from gateway.clock.threads import ThreadPerCall
from gateway.config.reading.masking import shown
from gateway.errors import ConfigError, Unready
from gateway.operator.config.commands import commands_to_apply
from gateway.operator.operations.answers.config import CheckedConfig, ConfigInUse
from gateway.operator.operations.asked import TextToCheck
from gateway.operator.operations.operation import Asker, IsThere, Nothing
from gateway.operator.operator import Operator
from gateway.readconfig.text_check import TextCheck, TextProblem, check_text

#: So many may wait to have their texts checked.
MOST_WAITING: Final = 8


class TextChecks:
    """Checks one text at a time, and rests as long afterwards: half a processor at most, at a lower priority."""

    def __init__(self) -> None:
        self._turn = asyncio.Lock()
        self._waiting = 0
        self._free_at = 0.0

    async def check(self, operator: Operator, text: str, is_there: IsThere) -> TextCheck:
        """Check a text in the turn of whoever asks.

        Raises:
            Unready: too many others wait, or whoever has asked is gone.
        """
        if self._waiting == MOST_WAITING:
            raise Unready("other texts are being checked; try again in some seconds")
        self._waiting += 1
        try:
            async with self._turn:
                return await self._check(operator, text, is_there)
        finally:
            self._waiting -= 1

    async def _check(self, operator: Operator, text: str, is_there: IsThere) -> TextCheck:
        loop, reloader = asyncio.get_running_loop(), operator.reloader
        await asyncio.sleep(self._free_at - loop.time())
        if not is_there():
            raise Unready("the client has gone")
        begun = loop.time()
        check = partial(check_text, reloader.file.absolute(), text, reloader.text)
        try:
            return await loop.run_in_executor(ThreadPerCall("check config"), check)
        except ConfigError as error:  # the text takes too long, or too much memory
            return TextCheck((TextProblem("error", 0, 0, "", str(error)),))
        finally:
            self._free_at = 2 * loop.time() - begun


async def tell_config(operator: Operator, _asked: Nothing, _asker: Asker) -> ConfigInUse:
    """Return the config in use, without comments and secrets."""
    reloader = operator.reloader
    text = await asyncio.get_running_loop().run_in_executor(ThreadPerCall("mask config"), shown, reloader.text)
    return ConfigInUse(reloader.place, text)


async def check_config(operator: Operator, asked: TextToCheck, asker: Asker) -> CheckedConfig:
    """Check a text, and compare it with the config in use; nothing is written, and nothing that it names is opened.

    Raises:
        Unready: too many others wait.
    """
    found = await operator.kept(TextChecks).check(operator, asked.text, asker.is_there)
    commands: Sequence[str] = ()
    if not found.has_errors:
        commands = await asyncio.get_running_loop().run_in_executor(
            ThreadPerCall("check config"), commands_to_apply, operator.reloader
        )
    return CheckedConfig(
        not found.has_errors, found.problems, found.changes, found.difference, found.notes, tuple(commands)
    )
