"""Rules that find what is wrong with a set-up, and what mends it. `service` gathers the evidence."""
