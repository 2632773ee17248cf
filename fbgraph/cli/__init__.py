"""The command line: reads arguments, calls the pipeline, prints. The only rooms that print or exit.

``app`` holds the options that commands share, errors and exit codes; ``smooth_online``, ``run_commands`` (view, record,
guide), ``evaluate_plot``, ``inspect_convert``, ``export_commands`` and ``simulate_study`` (formats and config too) the
commands;
``printing`` the tables.
"""

# isort: off  the order in which help lists the commands
from fbgraph.cli import (  # noqa: F401
    evaluate_plot,
    export_commands,
    inspect_convert,
    run_commands,
    simulate_study,
    smooth_online,
)
from fbgraph.cli.app import main

__all__ = ["main"]
