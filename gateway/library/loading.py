"""Loads the libraries of a config's parts in a thread: the event loop of the program goes on meanwhile."""

import asyncio
from collections.abc import Iterator
from contextlib import suppress
from importlib import import_module

from gateway.clock.threads import ThreadPerCall
from gateway.config.plan.settings import Plan


async def load_libraries(plan: Plan) -> None:
    """Load what `plan` needs beside the rest. A library that is missing is told by its part."""
    modules = [*_needed(plan)]
    if modules:
        await asyncio.get_running_loop().run_in_executor(ThreadPerCall("load libraries"), _load, modules)


def _needed(plan: Plan) -> Iterator[str]:
    if plan.web is not None:
        yield "gateway.web.front.server"
    if plan.mqtt is not None:
        yield from ("gateway.runtime.mqtt.publication", "gateway.plant.broker", "gateway.plant.client")
    if plan.fleet is not None:
        yield from ("gateway.fleet.link", "gateway.fleet.exchange", "gateway.fleet.serving", "gateway.fleet.presence")


def _load(modules: list[str]) -> None:
    for each in modules:
        with suppress(ModuleNotFoundError):
            import_module(each)
