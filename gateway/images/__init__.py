"""Local register images: units that the gateway answers itself.

- image, tables, services    the answers of an image: reads and writes, diagnostics and identification
- persistent   an image whose writes survive a crash (ADR 8)
- mirror, polling, polls    polls of a device, answers from its last values, and their age
- self_image, self_map    the registers of the gateway itself (docs/own-registers.md)
- last_writes  the last writer of each value
- drivers      the parts that use the event loop, threads and files; all else is pure
"""
