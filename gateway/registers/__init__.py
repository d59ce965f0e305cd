"""Coils and registers: the values they carry, their reference numbers, and the requests that read and write them."""
