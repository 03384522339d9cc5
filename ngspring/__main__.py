"""``python -m ngspring`` is the command line."""

from ngspring.cli import main

main()
