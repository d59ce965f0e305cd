"""Downstream: the transaction machine of a line, its queue, and the devices that requests are routed to."""
