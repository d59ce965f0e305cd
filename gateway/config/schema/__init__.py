"""Every key of the config file, its kind and its default: a module for each section. `config` has them all."""
