"""The process of a gateway: started, watched and stopped.

- daemon       the log, the state, signals, and what is open while it runs
- supervisor   start, ready, serve, drain, stop
- systemd, watchdog    notifications to systemd
- hang_up      the meaning of SIGHUP
"""
