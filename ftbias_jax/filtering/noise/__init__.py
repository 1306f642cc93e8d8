"""Noise that a recorded log shows: contact, vibration, slow errors, from blocks of a twentieth of a second."""
