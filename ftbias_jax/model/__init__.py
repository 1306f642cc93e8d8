"""Model of the sensor's reading: parameters, kinematics, wrench of the tool, effects, simulation."""
