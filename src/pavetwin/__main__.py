"""`python -m pavetwin`: the command line, where the command itself is not installed."""

from pavetwin.cli import main

if __name__ == "__main__":
    main()
