"""The version, and where the documentation of the web page is."""

__version__ = "0.1.0"
DOCUMENTATION = "https://docs.modbus-gateway.example/web.html"
