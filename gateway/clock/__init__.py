"""The event loop, its timers, and threads for calls that may never return.

- exact_loop, waiter    the event loop and its waiting (ADR 9)
- system_calls, _system_calls    what it asks of the kernel for each request, in Python and in C (ADR 43)
- lazy_timer   one timer for each line
- beside       tasks beside others
- slices       long readings, with pauses for the lines
- threads      calls into drivers
- loop_thread  a thread with an event loop of its own
- times        times of day as text
- setting      how the wall clock is set
"""
