"""What the sensor should read: parameters, kinematics, the wrench of the tool, effects, simulation."""
