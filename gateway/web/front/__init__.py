"""HTTP connections, from their place among others to the answer."""
