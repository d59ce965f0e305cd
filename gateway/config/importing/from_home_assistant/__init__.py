"""A config out of the `modbus:` section of Home Assistant: lines, upstreams, devices, and their points.

- config       the whole: a file in, a config out, with the [mqtt] with which its entities come back
- fields       YAML with Home Assistant's tags, and the keys of a table
- hub, device  a connection as a line or an upstream, and what is behind it
- entities     what it shows and switches, as points
- layout       data types, structures and swaps

Its format and its defaults are those of the documentation and the schema of its integration "modbus".
"""
