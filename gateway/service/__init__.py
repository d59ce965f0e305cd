"""The service: builds, starts, watches and stops the parts that a config describes."""
