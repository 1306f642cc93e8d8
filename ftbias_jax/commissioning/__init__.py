"""From a log to a setup that can be trusted: every step kept only if it predicts what it has not seen."""
