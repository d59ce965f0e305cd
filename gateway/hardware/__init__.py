"""Serial adapters: which there are, who uses them, and what their drivers are asked."""
