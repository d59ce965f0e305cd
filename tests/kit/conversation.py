"""Conversations: scripts that read as what passes between clients, the gateway and a line.

    # R02 a silent device
    client >> 01 03 00 10 00 01          the client sends: unit, PDU
    rtu    >> 01 03 00 10 00 01 85 CF    the gateway puts this on the line `rtu`
    rtu    << 01 03 02 01 10 B8 18       a device says this
    wait 200 ms
    client << 01 83 0B                   the client gets: unit, PDU
    rtu    silent                        nothing else was put on the line

Frames of ASCII lines are written as text, without their CR LF; `\\r`, `\\n` and `\\x00` stand for themselves in others.
A step with `>>` of a line or `<<` of a client waits until that happens.

A block begins with its title, a comment; an empty line ends it. Further comments are for the reader. Settings
(`line: retries = 1`, `unit 2: timeout = 2 s`) stand before the steps; those of a block without steps are for all blocks
behind it. With `mode = rtu or ascii` a conversation is played in both modes. Which settings there are, and what else
may happen, is for the stage: this module's plays on a whole gateway without settings, `line_stage` on one line.
"""

import asyncio
import re
from dataclasses import dataclass, replace
from pathlib import Path

from kit.gateway_bench import PATIENCE, Client, GatewayBench

_STEP = re.compile(r"(\w+)\s+(>>|<<|silent)?\s*(.*)")
_SETTING = re.compile(r"\w+( \d+)?: .*")


@dataclass(frozen=True)
class Conversation:
    """A title, its steps, and the settings of what it is played on."""

    title: str
    steps: tuple[str, ...]
    settings: tuple[str, ...] = ()


def conversations(file: Path) -> list[Conversation]:
    """Read those in a file."""
    found: list[Conversation] = []
    for_all: tuple[str, ...] = ()
    for block in file.read_text().strip().split("\n\n"):
        title, *lines = block.splitlines()
        lines = [line for line in lines if not line.startswith("#")]
        settings = tuple(line for line in lines if _SETTING.fullmatch(line) and not line.startswith("counts"))
        steps = tuple(line for line in lines if line not in settings)
        if steps:
            found += _in_each_mode(Conversation(title.removeprefix("# "), steps, for_all + settings))
        else:
            for_all += settings
    return found


def _in_each_mode(conversation: Conversation) -> list[Conversation]:
    modes = re.findall(r"mode = (\w+(?: or \w+)?)", "\n".join(conversation.settings))[-1:]
    if modes != ["rtu or ascii"]:
        return [conversation]
    title, settings = conversation.title, conversation.settings
    return [
        replace(conversation, title=f"{title} ({mode})", settings=(*settings, f"line: mode = {mode}"))
        for mode in ("rtu", "ascii")
    ]


class Stage:
    """Plays conversations on a gateway bench. Lines are known by their port's name."""

    def __init__(self, bench: GatewayBench) -> None:
        self._home = bench
        self._clients: dict[str, Client] = {}

    async def play(self, conversation: Conversation) -> None:
        for step in conversation.steps:
            who, what, rest = _STEP.fullmatch(step.strip()).groups()
            if who == "wait":
                await asyncio.sleep(seconds(rest))
            elif who.startswith("client"):
                await self._client(who, what, rest)
            else:
                await self._line(who, what, rest)

    async def _client(self, who: str, what: str, text: str) -> None:
        client = self._clients.setdefault(who, self._home.client(f"{who}:1"))
        if what == ">>":
            unit, _, pdu = text.partition(" ")
            client.ask(int(unit, 16), pdu)
        elif what == "silent":
            assert client.responses.empty(), client.responses.get_nowait()
        else:
            async with asyncio.timeout(PATIENCE):
                _, unit, pdu = await client.responses.get()
            assert f"{unit:02X} {pdu}" == text

    async def _line(self, who: str, what: str, text: str) -> None:
        line = self._home.lines[who]
        if what == "<<":
            line.deliver(_frame(text))
            return
        if what == ">>":
            async with asyncio.timeout(PATIENCE):
                while not line.written:  # noqa: ASYNC110 - virtual time
                    await asyncio.sleep(0.0001)
        assert _shown(line.take_written(), text) == text


def _frame(text: str) -> bytes:
    if ":" in text or "\\" in text:
        text = text if "\\" in text else text + "\\r\\n"
        return text.encode().decode("unicode_escape").encode("latin-1")
    return bytes.fromhex(text)


def _shown(data: bytes, like: str) -> str:
    return data.decode().removesuffix("\r\n") if like.startswith(":") else data.hex(" ").upper()


def seconds(text: str) -> float:
    """Read a duration: `200 ms`, `2 s`."""
    number, unit = text.split()
    return float(number) * {"s": 1.0, "ms": 0.001}[unit]
