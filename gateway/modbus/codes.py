"""Function codes, areas and sizes of the Modbus protocol; which requests change nothing."""

from enum import IntEnum, StrEnum
from typing import Final


class FunctionCode(IntEnum):
    """Public function codes that the gateway understands (Application Protocol V1.1b3, section 6)."""

    READ_COILS = 1
    READ_DISCRETE_INPUTS = 2
    READ_HOLDING_REGISTERS = 3
    READ_INPUT_REGISTERS = 4
    WRITE_SINGLE_COIL = 5
    WRITE_SINGLE_REGISTER = 6
    READ_EXCEPTION_STATUS = 7
    DIAGNOSTICS = 8
    GET_COMM_EVENT_COUNTER = 11
    GET_COMM_EVENT_LOG = 12
    WRITE_MULTIPLE_COILS = 15
    WRITE_MULTIPLE_REGISTERS = 16
    REPORT_SERVER_ID = 17
    READ_FILE_RECORD = 20
    WRITE_FILE_RECORD = 21
    MASK_WRITE_REGISTER = 22
    READ_WRITE_MULTIPLE_REGISTERS = 23
    READ_FIFO_QUEUE = 24
    ENCAPSULATED_INTERFACE = 43


class Area(StrEnum):
    """The four tables of a unit (A 4.3), named as in the config file and on the command line."""

    COILS = "coils"
    DISCRETE = "discrete"
    INPUT = "input"
    HOLDING = "holding"


#: Set in the function code of an exception response (A 4.1).
EXCEPTION_BIT: Final = 0x80

#: The MEI type of function 43 that reads what a device is (A 6.21).
DEVICE_IDENTIFICATION: Final = 14

#: Functions that cannot change a device. Whatever is not known to only read is a write.
READING_FUNCTIONS: Final = frozenset({1, 2, 3, 4, 7, 11, 12, 17, 20, 24})

#: How a request begins that reads what a device is: the one use of function 43 that is known to only read.
READING_IDENTIFICATION: Final = bytes((FunctionCode.ENCAPSULATED_INTERFACE, DEVICE_IDENTIFICATION))

#: Functions that may go to unit 0: every device acts, none responds (S 2.1).
BROADCAST_FUNCTIONS: Final = frozenset({5, 6, 15, 16, 22})

#: Largest PDU (A 4.1) and the largest ADU around it on each transport (T 4.2, S 2.5.1, S 2.5.2).
MAX_PDU: Final = 253
MAX_TCP_ADU: Final = 260
MAX_RTU_ADU: Final = 256
MAX_ASCII_ADU: Final = 513

#: Unit identifiers on a serial line (S 2.2).
BROADCAST_UNIT: Final = 0
FIRST_UNIT: Final = 1
LAST_UNIT: Final = 247
#: What Modbus TCP clients send when they mean the server itself, not a unit behind it (T 4.4.1.2).
SERVER_UNIT: Final = 255


def only_reads(pdu: bytes) -> bool:
    """Whether a request is known to change nothing."""
    return pdu[0] in READING_FUNCTIONS or pdu.startswith(READING_IDENTIFICATION)
