"""What `check`, `status` and `trace` print."""
