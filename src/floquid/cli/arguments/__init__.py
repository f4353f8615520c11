"""Arguments of commands: options, settings, records, and points of a survey."""
