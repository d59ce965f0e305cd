"""From a unit identifier to its target, and the rights of clients."""
