"""The control socket, where the other commands of this program ask a gateway at work."""
