"""``ngspring`` and ``python -m ngspring``: the command line."""

from ngspring.cli.signals import leaving_at_once


def main() -> None:
    """Entry point of the console script."""
    with leaving_at_once():
        from ngspring.cli.main import cli
    cli.main(prog_name="ngspring")


if __name__ == "__main__":
    main()
