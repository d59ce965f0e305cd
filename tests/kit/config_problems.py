"""What `check` says of a config, without its place in the file."""

from textwrap import dedent

from gateway.config.load import parse
from gateway.config.problem import dotted

#: A line with a device.
LINE = '[[line]]\nname = "a"\nport = "/dev/a"\ndevices = [{ unit = 1, name = "one" }]\n'


def problems(text, port_trouble=lambda _: None, real_path=str):
    """Say what is wrong with `text`."""
    found = parse(dedent(text), port_trouble=port_trouble, real_path=real_path).problems
    return [
        f"{one.severity}: {dotted(one.path)}: {one.what}" + (f" | {one.remedy}" if one.remedy else "") for one in found
    ]
