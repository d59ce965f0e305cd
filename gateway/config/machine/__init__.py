"""What is seen of this machine: the text of a file, ports, addresses and rights."""
