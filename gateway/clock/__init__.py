"""The event loop, its timers, and threads for calls that may never return."""
