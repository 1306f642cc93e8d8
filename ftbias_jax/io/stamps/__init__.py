"""Stamps of recorded streams: their clocks, their order, and the steady clock behind jittering stamps."""
