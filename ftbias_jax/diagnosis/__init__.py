"""Where a log departs from the model, which effect causes it, and how far it shrinks once the effect is added."""
