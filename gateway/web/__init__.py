"""The gateway over HTTP. Loaded only if the config has `[web]`."""
