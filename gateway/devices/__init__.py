"""The targets on a line: its devices, broadcasts, and devices that deviate from the protocol.

- device       each device, all of them for broadcasts, and units that a scan looks for
- addresses, moved    devices that can change their addresses
- quirks       devices that deviate
- heard        a device of a monitor line: never asked, only heard
"""
