"""The crossroads: from a unit identifier to what answers for it, and who may ask for what."""
