"""``python -m fbgraph.cli``."""

from fbgraph.cli import main

main()
