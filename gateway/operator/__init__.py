"""What an operator asks of a gateway at work, and its answers."""
