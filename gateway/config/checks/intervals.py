"""Cross-checks of how often mirrors and virtual units read. What is only heard on a monitor line is never read."""

from collections.abc import Iterator, Mapping

from gateway.config.plan.names import heard_on
from gateway.config.problem import Path, Problem, error, warning
from gateway.config.schema.config import Config


def check_intervals(config: Config, failed: frozenset[str]) -> Iterator[Problem]:
    """Find rows without `every`, rows that have it though others ask, and rows that would write there."""
    if failed & {"line", "upstream"}:  # what is a device of a monitor line is not known
        return
    heard = heard_on(config)
    for image in config.image:
        for row in image.read if image.of is not None else ():
            yield from _check(row.path, image.of, row.every, "500 ms", heard)
        for mapped in image.map:
            if mapped.device is None:
                continue
            yield from _check(mapped.path, mapped.device, mapped.every, "1 s", heard)
            if mapped.write and mapped.device in heard:
                what = f"nothing is ever sent on {heard[mapped.device]}: writes to this row are answered 0A"
                yield warning((*mapped.path, "write"), what, "take it out")


def _check(
    path: Path, device: str | None, every: float | None, usual: str, heard: Mapping[str, str]
) -> Iterator[Problem]:
    line = heard.get(device or "")
    if line is None:
        if every is None:
            yield error(path, "every is missing", f'say how often it is read, such as every = "{usual}"')
    elif every is not None:
        what = f"others ask {device}, and the gateway only listens on {line}: nothing is read there"
        yield error((*path, "every"), what, "take it out: values come when they are heard")
