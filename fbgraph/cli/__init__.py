"""The command line: reads arguments, calls the pipeline, prints. The only rooms that print or exit.

``app`` holds the options that commands share, errors, exit codes and the order of help; ``printing`` the tables. The
commands, which are known once they are imported, are in ``smooth_online``, ``batch_report``, ``play_command``,
``run_commands`` (view, record, guide), ``evaluate_plot``, ``inspect_convert``, ``export_commands``,
``calibrate_command``, ``learn_commands`` and ``simulate_study`` (formats and config too).
"""

from fbgraph.cli import (
    batch_report,
    calibrate_command,
    evaluate_plot,
    export_commands,
    inspect_convert,
    learn_commands,
    play_command,
    run_commands,
    simulate_study,
    smooth_online,
)
from fbgraph.cli.app import main

__all__ = [
    "batch_report",
    "calibrate_command",
    "evaluate_plot",
    "export_commands",
    "inspect_convert",
    "learn_commands",
    "main",
    "play_command",
    "run_commands",
    "simulate_study",
    "smooth_online",
]
