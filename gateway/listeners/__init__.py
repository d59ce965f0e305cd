"""The gateway's listeners and the sessions of their clients."""
