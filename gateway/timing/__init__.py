"""How long a device may take: its timing table, and the limit of a transaction on a line."""
