"""Units as commands read and write them: through the gateway or directly."""
