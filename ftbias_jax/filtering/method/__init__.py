"""The passes over a recorded log: joints smoothed, the noise that the log shows, the bias filtered sample by sample."""
