"""modbus-gateway: Modbus clients on one side, serial lines full of devices on the other."""

__version__ = "0.1.0"
