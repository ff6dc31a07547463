"""`python -m stlbench`: the command line, where its script is not on the path."""

from stlbench.cli import main

if __name__ == "__main__":
    main()
