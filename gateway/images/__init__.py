"""Local register images: units that the gateway itself answers for."""
