"""`python -m floquid`: the command line."""

from floquid.cli import main

if __name__ == "__main__":
    main()
