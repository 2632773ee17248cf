"""The command line: reads arguments, calls the pipeline, prints. The only rooms that print or exit.

``app`` holds the options that commands share, errors and exit codes; ``walking``, ``looking`` and ``making`` the
commands; ``printing`` the tables.
"""

# isort: off  the order in which help lists the commands
from fbgraph.cli import looking, making, walking  # noqa: F401
from fbgraph.cli.app import main

__all__ = ["main"]
