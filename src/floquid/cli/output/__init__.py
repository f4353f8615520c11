"""What commands write: to the terminal, and to folders of results."""
