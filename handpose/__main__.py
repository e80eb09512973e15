"""The command ``handpose``: ``python -m handpose COMMAND ...``."""

from __future__ import annotations

from netlib.__main__ import main as run


def main() -> None:
    """Run the command that the command line names."""
    run("handpose")


if __name__ == "__main__":
    main()
