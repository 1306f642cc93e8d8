"""The joint filter, the bias filter, and the pipeline that combines them."""
