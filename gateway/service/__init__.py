"""The service: the parts that a config asks for, joined, started, watched and stopped."""
