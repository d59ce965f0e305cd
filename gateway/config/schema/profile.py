"""The keys of kinds of devices and of points."""

from typing import Annotated, Literal

from pydantic import Field

from gateway.config.schema.table import Count, FunctionNumber, Table
from gateway.config.values.key_types import (
    AnswerDuration,
    Duration,
    DurationOrZero,
    KindIdentity,
    Limits,
    ListOf,
    PointAddresses,
    PointBits,
    PointInvalid,
    PointLabels,
    PointName,
    PointWriting,
    Ranges,
    Wide,
)
from gateway.devices.quirks import Quirk
from gateway.registers.datatypes import DataType, Swap
from gateway.registers.items import WriteFunction

#: A limit of values.
Limit = Annotated[float, Field(allow_inf_nan=False)]


class PointTable(Table):
    """What a register, or several of them, or a coil means. Exactly one of the four areas must be given."""

    name: PointName = Field(
        description="Its name for `read` and `write`. Required with a range of addresses: `*`, which stands for the "
        "number of each point.",
    )
    holding: PointAddresses | None = Field(
        None, description='A holding register, the first one of a value; a range `"1-99"` makes several points.'
    )
    input: PointAddresses | None = Field(None, description="The same for input registers.")
    coils: PointAddresses | None = Field(None, description="The same for coils.")
    discrete: PointAddresses | None = Field(None, description="The same for discrete inputs.")
    first: Annotated[int, Field(ge=0)] | None = Field(
        None, description="With a range: the number of the first point, for `*`. Default: its address."
    )
    type: DataType | None = Field(
        None,
        description="How the value is encoded. Default: `uint16`, and `uint8` with `byte`; coils and discrete inputs "
        "are always `bit`.",
    )
    bit: Annotated[int, Field(ge=0, le=63)] | None = Field(
        None, description="One bit of the register, or of the registers of its type: 0 is the lowest."
    )
    bits: PointBits | None = Field(None, description='Some bits of it, a number of their own: `"4-6"`.')
    byte: Literal["high", "low"] | None = Field(
        None,
        description="One byte of it, of type `uint8` or `int8`, whose default is `low`; with `string` the byte of each "
        "register that has a character.",
    )
    length: Annotated[int, Field(ge=1, le=125)] | None = Field(
        None, description="The registers of a `string`; other types know their own."
    )
    swap: Swap = Field(
        "none",
        description="`none`: the first register has the highest word, and high bytes come first. `words`: the first "
        "register has the lowest word. `bytes`: low bytes come first. `both`: both.",
    )
    scale: Annotated[float, Field(allow_inf_nan=False)] = Field(
        1.0, description="The value is the number in the registers times this, plus `offset`."
    )
    offset: Annotated[float, Field(allow_inf_nan=False)] = Field(0.0, description="See `scale`.")
    scale_from: PointName | None = Field(
        None,
        description="The point with the power of ten by which the number is multiplied first, an int16 (SunSpec's "
        "scale factor). Both are read with one request.",
    )
    decimals: Annotated[int, Field(ge=0, le=15)] | None = Field(
        None, description="Decimals of the value. Default: as many as it needs."
    )
    unit: str = Field("", description='The unit of the value, such as `"kg"`.')
    labels: PointLabels = Field(
        {},
        description="Text for some of the numbers in the register, instead of a value. The numbers may be as `0x10`.",
    )
    invalid: PointInvalid = Field(
        (),
        description="The numbers in the register that mean that there is no value, such as 0x8000; with `bit` and "
        "`bits` those of the whole register, with `byte` those of the byte. A float that is infinite or not a number "
        "never is a value.",
    )
    min: Limit | None = Field(None, description="The lowest value that may be written, by whatever client.")
    max: Limit | None = Field(None, description="The highest value that may be written, by whatever client.")
    write: PointWriting = Field(
        "no", description='Whether it can be written. `"only"`: it cannot be read, and is left out when all are.'
    )

    write_at: Annotated[int, Field(ge=0, le=65535)] | None = Field(
        None,
        description="The address where it is written, if that is another one: a holding register, or a coil; with "
        "a range that of the first point. Default: its own.",
    )
    write_function: WriteFunction | None = Field(
        None, description="The function that writes it, as in the profile. Default: the one of the profile."
    )


class TimingRow(Table):
    """A point of a timing table."""

    fc: FunctionNumber = Field(description="The function.")
    items: Count = Field(description="Coils or registers in the request.")
    time: AnswerDuration = Field(description="How long the device needs for them.")


class ProfileTable(Table):
    """What a kind of device accepts, and how fast it responds."""

    title: str = Field("", description="The kind of device, as text.")
    maker: str = Field("", description="Its maker.")
    source: str = Field("", description="The document that this is out of: title, edition, pages.")
    seen: Literal["", "printed frames", "simulated", "hardware"] = Field(
        "", description="What it was tried with: frames that a document prints, a simulation, a device."
    )
    identity: KindIdentity | None = Field(
        None,
        description="How `scan` recognises it: `fc43` is the beginning of a text that it tells with function 43/14; "
        "`holding` or `input` is a register that `equals` a number; `sunspec` are models in its chain of SunSpec "
        "models, where the points are (those with the same registers count too: 101 for 103).",
    )
    mode: Literal["rtu", "ascii"] | None = Field(
        None, description="The mode of these devices, if they have only one: `check` warns of a line with the other."
    )
    functions: Annotated[tuple[FunctionNumber, ...], ListOf] | None = Field(
        None, description="Functions that it knows; others are answered 01 and not sent. Default: all."
    )
    limits: Limits = Field(
        {}, description="The maximum number of items in a request, by function; more are answered 03."
    )
    holding: Ranges | None = Field(
        None, description="Holding registers that exist; others are answered 02. Default: all."
    )
    input: Ranges | None = Field(None, description="Input registers that exist. Default: all.")
    coils: Ranges | None = Field(None, description="Coils that exist. Default: all.")
    discrete: Ranges | None = Field(None, description="Discrete inputs that exist. Default: all.")
    wide: Wide = Field(
        {},
        description="Registers that have four bytes each (Enron). A request for them lies wholly inside; 62 is the "
        "most of a read, and function 06 does not write them.",
    )
    max_gap: Annotated[int, Field(ge=0, le=2000)] = Field(
        0, description="Points are read with one request over so many addresses between them that no point has."
    )
    idle_chars: Annotated[float, Field(gt=0, le=1000)] = Field(
        3.5, description="The silence that ends a frame, in characters."
    )
    timing: Annotated[tuple[TimingRow, ...], ListOf] = Field(
        (), description="Answer time by function and item count; points are joined by straight lines."
    )
    margin: Annotated[float, Field(ge=1, le=100)] = Field(1.5, description="Times are multiplied by it, to be safe.")
    timeout: Duration = Field(1.0, description="The time for functions that are not in `timing`.")
    wake: DurationOrZero = Field(
        0.0,
        description="For devices that sleep: after so long without a request, the first read is sent twice, the second "
        'time when its limit has passed. `"0"`: they do not sleep.',
    )
    coil_values: Literal["checked", "any"] = Field(
        "checked",
        description="`any`: function 05 is sent with other values than FF00 and 0000 too, by which relay boards toggle "
        "or pulse. `checked`: such requests are answered 03.",
    )
    write_function: WriteFunction = Field(
        "auto",
        description="The functions that write its points. `auto`: 05 or 06 for one item and 15 or 16 for several. "
        "`single`: 05 or 06. `multiple`: 15 or 16.",
    )
    quirks: Annotated[tuple[Quirk, ...], ListOf] = Field(
        (),
        description="Deviations from the protocol. `moves`: a write to holding register 0x0100 sets the address of the "
        "device. `changes_baud`: a float32 written to 0x0200-1 sets its baud rate.",
    )
    points: Annotated[tuple[PointTable, ...], ListOf] = Field(
        (), description="What its registers mean: names for `read` and `write`."
    )
