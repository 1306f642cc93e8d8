"""What is not in the catalogue, described by a sparse sum of terms: drives that act on the tool or on the sensor."""
