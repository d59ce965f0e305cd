"""Local register images: units that the gateway answers itself.

- image, tables, services    the answers of an image: reads and writes, diagnostics and identification
- persistent   an image whose writes survive a crash (ADR 8)
- polls, polling, polled_range, due, turns    polls of a device for all that want its values, and the age of these
- places       what a read or a write touches
- supply, heard_values    what supplies values: polls, or what others ask and the gateway hears
- mirror, virtual, ordered    units whose reads are answered from polls, and which pass other requests on
- custom_unit, custom_image, custom_calls    a unit made in Python: what its author writes, the target, its calls
- self_image, self_map    the registers of the gateway itself (docs/own-registers.md)
- last_writes  the last writer of each value
- drivers      the parts that use the event loop, threads and files; all else is pure
"""
