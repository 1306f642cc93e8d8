"""Withheld kinds of effects: physics that is in no catalogue, with the drive that a description should find."""
