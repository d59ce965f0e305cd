"""The settings of every part of a gateway, and what follows from them."""
