"""Local register images: units that the gateway answers itself.

- image, tables, services    what an image answers: reads and writes, diagnostics and identification
- persistent   an image whose writes survive a crash (ADR 8)
- mirror, polling, polls    the last values of a device, how they are polled, and when they are too old
- self_image, self_map    the registers of the gateway itself (docs/own-registers.md)
- last_writes  who has written last
- drivers      what uses the event loop, threads and files; all else here is pure
"""
