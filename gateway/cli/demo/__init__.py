"""What the demo runs and prints."""
