"""The parts of images that use the event loop, threads and files."""
