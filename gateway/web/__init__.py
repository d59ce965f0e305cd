"""The gateway over HTTP: pages, API, metrics. Loaded only if the config has `[web]`; `users` also by its command."""
