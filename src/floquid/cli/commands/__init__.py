"""The commands, a file each; `identify` has `report`, and `demo` has `simulate`."""
