"""What ``identify`` is made of: bodies that can exist, what a motion shows of them, mountings, poses, the sensor."""
