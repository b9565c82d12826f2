"""The command line. Imports what a command needs only when it runs."""

from desim_uav.cli.main import app, main

__all__ = ["app", "main"]
