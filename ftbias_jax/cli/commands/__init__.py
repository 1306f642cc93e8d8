"""The subcommands of ``ftbias``; each module imports the heavy packages inside its ``run``."""
