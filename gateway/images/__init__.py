"""Local register images: units that the gateway answers itself."""
