"""Commands for third-party simulators and controllers."""
