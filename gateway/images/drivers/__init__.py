"""What of images uses the event loop, threads and files; all else of them is pure."""
