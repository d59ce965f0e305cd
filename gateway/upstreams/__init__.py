"""Units behind other Modbus TCP servers."""
