"""The process of a gateway: started, watched and stopped.

- daemon       the log, the state, signals, and what is open while it runs
- supervisor   start, ready, serve, drain, stop
- systemd, watchdog    what systemd is told
- hang_up      what SIGHUP means
"""
