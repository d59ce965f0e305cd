"""What a line offers to the router: its devices, and how some of them stray from the protocol."""
