"""`python -m stlbench`: the command line, where its script is not on the path."""

import sys

if __name__ == "__main__":
    if not sys.flags.safe_path:
        del sys.path[0]  # the working directory, from which nothing of a stranger may be imported
    from stlbench.cli import main

    main()
