"""What is wrong with a set-up, and what mends it: rules over evidence that others have gathered."""
