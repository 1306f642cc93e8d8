"""What a recorded log shows of its noise: contact, vibration, slow errors, in blocks of a twentieth of a second."""
