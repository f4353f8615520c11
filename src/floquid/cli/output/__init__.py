"""Output of commands: on the terminal, and in folders of results."""
