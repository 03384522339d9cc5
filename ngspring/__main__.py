"""``python -m ngspring`` is the command line."""

from ngspring.cli.main import main

main()
