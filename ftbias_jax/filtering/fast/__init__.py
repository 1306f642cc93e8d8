"""The same filters, faster: each proven equal to the reference step by a test."""
