"""Withheld kinds of effects, whose physics is in no catalogue, with the drive that a description should find."""
