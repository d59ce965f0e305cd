"""The numbers of the Modbus protocol: function codes, sub-functions, areas, sizes and unit identifiers."""

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

    __hash__ = str.__hash__  # the hash of an Enum is slow (a Python function), and each table is looked up by it


#: Set in the function code of an exception response (A 4.1).
EXCEPTION_BIT: Final = 0x80

#: Codes of exceptions after which nothing has changed in the device: function, address, value, busy, no path (A 7).
WITHOUT_EFFECT: Final = frozenset({1, 2, 3, 6, 10})

#: Sub-functions of 08 (A 6.8.1).
RETURN_QUERY_DATA: Final = 0x00
CLEAR_COUNTERS: Final = 0x0A
COUNTERS: Final = range(0x0B, 0x13)
CLEAR_OVERRUN_COUNTER: Final = 0x14

#: Device identification: the MEI type of function 43, and the code that reads a single object (A 6.21).
DEVICE_IDENTIFICATION: Final = 14
ONE_OBJECT: Final = 4

#: Largest PDU (A 4.1) and the largest ADU around it on each transport (T 4.2, S 2.5.1, S 2.5.2).
MAX_PDU: Final = 253
MAX_TCP_ADU: Final = 260
MAX_RTU_ADU: Final = 256
MAX_ASCII_ADU: Final = 513

#: Unit identifiers on a serial line. Those above LAST_UNIT are reserved (S 2.2), and some devices have them.
BROADCAST_UNIT: Final = 0
FIRST_UNIT: Final = 1
LAST_UNIT: Final = 247
HIGHEST_UNIT: Final = 255
#: The unit identifier for the server itself in Modbus TCP (T 4.4.1.2).
SERVER_UNIT: Final = 255
