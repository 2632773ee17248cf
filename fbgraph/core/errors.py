"""What can go wrong, in the user's terms. Only ``cli`` turns these into messages and exit codes."""


class FbgraphError(Exception):
    """Anything fbgraph can explain in one line; ``exit_code`` is what the command line ends with."""

    exit_code = 1


class ConfigError(FbgraphError):
    """A configuration, preset or option that cannot be used."""

    exit_code = 2


class DataError(FbgraphError):
    """An input file that holds nothing usable; the message names the file and, where it can, the line or time."""

    exit_code = 3


class EstimationError(FbgraphError):
    """Good data, but no trajectory: the solver failed or diverged."""

    exit_code = 4
