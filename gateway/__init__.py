"""modbus-gateway: Modbus clients on one side, serial lines full of devices on the other."""

__version__ = "0.1.0"
#: Where the documentation of the web page is.
DOCUMENTATION = "https://modbus-gateway.example/source/blob/main/docs/web.md"
