"""Every key of the config file, table by table."""
