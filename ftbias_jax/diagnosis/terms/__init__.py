"""Description of what is not in the catalogue: a sparse sum of terms, drives that act on the tool or on the sensor."""
