"""Documents read strictly: YAML as plain text values, sections key by key, numbers with a message for each slip."""
