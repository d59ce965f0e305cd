"""The keys of `[[line]]`."""

import re
from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.device import Device
from gateway.config.schema.table import Count, Table
from gateway.config.values.key_types import (
    Duration,
    DurationOrAuto,
    DurationOrOffOrAuto,
    DurationOrZero,
    DurationOrZeroOrAuto,
    Format,
    LeaseName,
    LinePort,
    ListOf,
    LongerDuration,
    Name,
    Rs485Delay,
    ServedUnits,
)
from gateway.config.values.port import VirtualPort
from gateway.ports.port import Wire


class Line(Table):
    """A serial line: its port and settings, and its devices."""

    name: Name | None = Field(None, description="Its name in logs and metrics. Default: the last part of the port.")
    port: LinePort = Field(
        description="The serial device, preferably by its name in `/dev/serial/by-id/`; or a device server in raw TCP "
        "mode: `rtu+tcp://host:port`, `ascii+tcp://host:port`, which sets the `mode` too. `baud` and `format` must "
        "then equal the settings of the server. Server lines: `pty:NAME` is a virtual port for programs of this "
        "machine, a link in the folder of the control socket; `pty:/PATH` is a link elsewhere. See "
        "[old software](old-software.md).",
    )
    mode: Literal["rtu", "ascii"] = Field("rtu", description="What is spoken on the line.")
    baud: Annotated[int, Field(ge=1, le=100_000_000)] = Field(
        19200, description="Any rate; 14400 and other odd ones are set as custom rates."
    )
    format: Format | None = Field(
        None, description="Data bits, parity, stop bits. Default: `8E1` for RTU, `7E1` for ASCII."
    )
    role: Literal["client", "server", "monitor"] = Field(
        "client",
        description="`client`: the gateway polls the devices. `server`: the gateway answers a client on the line "
        "(HMI, PLC). `monitor`: others ask and answer, the gateway only listens, and never transmits.",
    )
    group: Annotated[str, Field(min_length=1)] = Field(
        "dialout", description="Virtual ports: programs of this group may open it. The service must be in the group."
    )
    rs485: Literal["adapter", "kernel"] = Field(
        "adapter", description="What controls the direction of an RS-485 line: the adapter, or the kernel (TIOCSRS485)."
    )
    rs485_delay: Rs485Delay | None = Field(
        None,
        description="With `rs485` = `kernel`: how long the driver waits between switching the transmitter on and the "
        "first bit, and between the last bit and switching it off. They count for time limits. Default: as the driver "
        "has them, usually none.",
    )
    echo: bool = Field(
        False,
        description="True if the adapter echoes what is sent; exactly that is then removed. With `wire` = `serial` an "
        "echo is detected and logged; with `direct` only on server lines.",
    )
    wire: Wire = Field(
        "auto",
        description="`serial`: there is a wire, so a response that arrives before the request can have been sent is "
        "rejected. `direct`: for a device without a wire (USB CDC, a virtual machine, a soft PLC), which may respond "
        "at once; an echo then cannot be told from the response to 05 or 06. `auto`: `direct` for virtual ports and "
        "device servers, otherwise `serial`, also for `ttyACM`, because some adapters use that name. If that is "
        "wrong, the log says `answer_too_early`.",
    )
    latency: DurationOrAuto = Field(
        None,
        description='The delay of a response by adapter and driver, at most. `"auto"`: 5 ms; USB adapters whose driver '
        "cannot be set to that, 20 ms; TCP, 100 ms.",
    )
    profile: str = Field(
        "generic", description="The profile of devices without their own, and of passed-through units."
    )
    timeout: Duration | None = Field(
        None,
        description="How long a device without its own profile may take to begin its response, for functions without a "
        "row in `timing`. Default: the `timeout` of `profile` (`generic`: 1 s).",
    )
    idle: DurationOrZero = Field(
        0.0,
        description="Device servers: the connection is closed after so long without a request, and opened for the "
        "next one. Not while a late response may come, nor within five minutes of a request of another client. "
        '`"0"`: never.',
    )
    after_connect: DurationOrZero = Field(
        0.0, description="Device servers: silence after connecting, before the first request."
    )
    wake: DurationOrZero = Field(
        0.0,
        description="For devices that sleep: after so long without a request to it, the first read of a device is sent "
        "twice, the second time when its limit has passed in silence. Until the other response has come, or its late "
        "window has ended, reads of that device with the same function wait, for `max_wait` at most. Default of its "
        'devices. `"0"`: they do not sleep.',
    )
    gap: DurationOrZeroOrAuto = Field(
        None,
        description="Silence before each request; on server lines, before each response. "
        '`"auto"`: the larger of t3.5 and the `idle_chars` of its devices, or of the units that it serves; '
        'none for ASCII. `"0"`: none.',
    )
    turnaround: DurationOrAuto = Field(
        None,
        description='Silence after a broadcast. `"auto"`: 100 ms, or `margin` x `timing` of the slowest device if '
        "longer.",
    )
    late_window: DurationOrAuto = Field(
        None,
        description="How long a late response is expected after a time-out or a damaged response. Until then no "
        "request with the same function is sent to that unit: it gets 0B at once, or waits if 250 ms or less are "
        'left. `"auto"`: twice the time limit of the request, or the longest time that the device may take for any '
        "request (its `timeout`, `margin` x its table) if that is more. With a time-out of 1 s, one lost response "
        "blocks that function of the unit for 2 s. Monitor lines: how long a request that has no answer keeps later "
        'answers of its unit and function from being values; `"auto"` is at least 5 s for a device without a table.',
    )
    queue: Count = Field(
        64,
        description="Maximum number of waiting requests. When it is exceeded, the client with most of them, by "
        "connection, then by address, gets 06 for its newest. Requests that share a transaction count separately.",
    )
    max_wait: LongerDuration = Field(2.0, description="A request that has waited longer is answered 06 and not sent.")
    retries: Annotated[int, Field(ge=0)] = Field(
        0,
        description="How often a read is repeated: at once after a damaged frame, after the late window when nothing "
        "came. Writes are never repeated.",
    )
    retry_within: DurationOrAuto = Field(
        None,
        description="The longest that a read with its repeats may take, counted from the first attempt. A repeat that "
        "cannot end by then is not sent: the client gets 0B at once. A repeat after silence needs at least limit + "
        'late window + limit. `max_wait` does not apply to repeats. `"auto"`: twice the sum of limit and late window, '
        "or more where that is too short for one repeat; `check` shows how long.",
    )
    rest: DurationOrOffOrAuto = Field(
        None,
        description='The longest back-off of a unit that does not answer. `"auto"`: one minute, or nine time limits if '
        'longer. With a short one, or `"off"`, a dead unit delays the other units more.',
    )
    coalesce: bool = Field(
        True,
        description="Waiting reads of different clients that are equal share one transaction. Reads of one client are "
        "sent one after the other.",
    )
    broadcast: bool = Field(True, description="Whether broadcasts go to this line too.")
    lease: LeaseName | None = Field(
        None,
        description="The name of a lease: of all gateways whose lines have it, one opens its port and sends requests. "
        "See [fleet](fleet.md).",
    )
    devices: Annotated[tuple[Device, ...], ListOf] | None = Field(
        None,
        description="Its devices. Without this key, every unit 1-247 is passed through if the line is the only one "
        "with `role` = `client`. If it is not, the key may be left out only if a `[[listen]]` names the line; only "
        "such listeners then lead to it.",
    )
    serves: ServedUnits | None = Field(
        None,
        description="Server lines: the units that the gateway answers for; others get no response. `all`: those that a "
        "listener leads to, for all of its clients.",
    )
    on_failure: Literal["exception", "silent"] = Field(
        "exception",
        description="Server lines: what the client gets instead of a device's response, as in `[[listen]]`.",
    )
    answer_within: LongerDuration = Field(1.0, description="Server lines: a response that takes longer is not sent.")
    broadcast_to: Literal["images", "all", "none"] = Field(
        "images",
        description="Server lines: where broadcasts go: to the images that the line serves, also to every line that "
        "accepts broadcasts, or nowhere.",
    )

    @property
    def label(self) -> str:
        """Give its name, or its default name."""
        return self.name or re.split("[/:]" if self.is_virtual else "/", str(self.port).rstrip("/"))[-1]

    @property
    def is_virtual(self) -> bool:
        """Whether its port is one that the gateway makes, for programs of this machine."""
        return isinstance(self.port, VirtualPort)

    @property
    def named_units(self) -> frozenset[int]:
        """The units that `serves` names by their numbers."""
        return frozenset(self.serves) if isinstance(self.serves, tuple) else frozenset()
