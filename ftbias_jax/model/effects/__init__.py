"""Effects that can make a real log differ from the model, as data: one catalogue entry per effect (``catalogue``).

``compose.predict`` is the model with any set of effects; simulator, fit, report and tests read the same entries.
"""
