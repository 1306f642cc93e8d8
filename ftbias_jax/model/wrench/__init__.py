"""The wrench that a tool with known inertial parameters exerts on the sensor."""
