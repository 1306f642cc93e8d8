"""What a recorded log itself says about contact and noise, where the setup leaves it open."""
