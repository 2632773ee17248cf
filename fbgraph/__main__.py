"""``python -m fbgraph``: the same as the command."""

from fbgraph.cli import main

main()
