"""Configs of other programs as one of ours.

- from_mbusd, from_modbus_proxy    one program each
- imported     what they share
"""
